//! The thread that writes: from the rings of the bus threads to the files.

use super::error::RecordingError;
use super::format::{Beginning, Header, Kind, MAGIC, NO_SOURCE, PAYLOAD_MAX, PartHeader, Record};
use super::part::Part;
use super::set;
use super::tap::{Drain, Tap, tap};
use crate::time::Monotonic;
use rustix::fs::{FlockOperation, flock};
use std::fs::{File, OpenOptions};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// How often the rings are emptied.
const DRAIN_EVERY: Duration = Duration::from_millis(100);
/// The longest that what is written stays in the system's memory only.
const SYNC_EVERY: Duration = Duration::from_millis(400);
/// How often time is marked while nothing is received.
const MARK_EVERY: Duration = Duration::from_secs(1);
/// How much later than it was received a frame may come out of a ring and still stand above its mark.
const STRAGGLE: Duration = Duration::from_millis(10);
/// The smallest limit of size, bytes.
pub const SIZE_LIMIT_MIN: u64 = 1 << 20;
/// A set with a limit has so many files when it is full: what is removed at once is an eighth.
const PARTS: u64 = 8;

/// What is to be recorded, and where.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The file. A recording that is there already goes on.
    pub path: PathBuf,
    /// The most bytes that all files of the set may have together, at least [`SIZE_LIMIT_MIN`]; none means no limit.
    pub size_limit: Option<u64>,
    /// The sources.
    pub header: Header,
}

/// How it fares.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// Frames written.
    pub frames: u64,
    /// Bytes written.
    pub bytes: u64,
    /// Frames dropped: rings were full, or the disk refused them.
    pub lost: u64,
    /// What the system says while it refuses to write.
    pub failing: Option<String>,
}

/// The writing thread. It writes everything that it was given and ends when this is dropped.
#[derive(Debug)]
pub struct Recorder {
    report: Arc<Mutex<Report>>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Recorder {
    /// Begins a recording, or a new session of the one that is there, and starts the thread, named `recorder`. There is a
    /// tap for each source of the plan's header.
    ///
    /// # Errors
    /// When the file is something else, is held by another program, or cannot be written.
    pub fn start(plan: Plan) -> Result<(Self, Vec<Tap>), RecordingError> {
        let (taps, drains): (Vec<Tap>, Vec<Drain>) =
            plan.header.sources.iter().map(|_| tap()).unzip();
        let files = Files::open(plan, random())?;
        let path = files.path.clone();
        let report = Arc::new(Mutex::new(Report::default()));
        let stop = Arc::new(AtomicBool::new(false));
        let writer = Writer {
            files,
            rows: drains.into_iter().map(Row::new).collect(),
            out: Vec::with_capacity(1 << 16),
            report: Arc::clone(&report),
            synced: Monotonic::read(),
            marked: None,
        };
        let seen = Arc::clone(&stop);
        let thread = std::thread::Builder::new()
            .name("recorder".into())
            .spawn(move || writer.run(&seen))
            .map_err(|source| RecordingError::Unwritable { path, source })?;
        let recorder = Self {
            report,
            stop,
            thread: Some(thread),
        };
        Ok((recorder, taps))
    }

    /// How it fares.
    #[must_use]
    pub fn report(&self) -> Report {
        self.report
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone()
    }

    /// A function that tells how it fares, for another thread.
    pub fn reporter(&self) -> impl Fn() -> Report + Send + use<> {
        let report = Arc::clone(&self.report);
        move || {
            report
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
                .clone()
        }
    }

    /// Writes what it was given until now, and ends.
    pub fn finish(mut self) -> Report {
        self.end();
        self.report()
    }

    fn end(&mut self) {
        self.stop.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            // A thread that panicked has written what it has written.
            let _ = thread.join();
        }
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        self.end();
    }
}

/// What is known of a source.
#[derive(Debug)]
struct Row {
    drain: Drain,
    /// Of the drain's losses, how many have been taken in.
    counted: u64,
    /// Lost, and not told in the recording yet.
    untold: u64,
    /// Of what is on its way to the disk: frames, and losses told.
    frames: u64,
    told: u64,
}

impl Row {
    const fn new(drain: Drain) -> Self {
        Self {
            drain,
            counted: 0,
            untold: 0,
            frames: 0,
            told: 0,
        }
    }
}

struct Writer {
    files: Files,
    rows: Vec<Row>,
    out: Vec<u8>,
    report: Arc<Mutex<Report>>,
    synced: Monotonic,
    marked: Option<Monotonic>,
}

impl Writer {
    fn run(mut self, stop: &AtomicBool) {
        loop {
            // Read before the rings: what was put there before the stop is seen after it.
            let stopping = stop.load(Ordering::Acquire);
            let now = Monotonic::read();
            self.drain(now);
            if stopping {
                let outcome = self.files.sync();
                self.tell(&outcome);
                return;
            }
            if now.since(self.synced).is_some_and(|age| age >= SYNC_EVERY) {
                self.synced = now;
                let outcome = self.files.sync();
                self.tell(&outcome);
            }
            std::thread::park_timeout(DRAIN_EVERY);
        }
    }

    /// Writes what the rings hold.
    fn drain(&mut self, now: Monotonic) {
        let mut payload = [0; PAYLOAD_MAX];
        let mut any = false;
        for i in 0..self.rows.len() {
            let source = u8::try_from(i).unwrap_or(NO_SOURCE);
            let row = &mut self.rows[i];
            let lost = row.drain.lost();
            row.untold += lost - row.counted;
            self.count(|report| report.lost += lost - self.rows[i].counted);
            self.rows[i].counted = lost;
            while let Some((kind, at, length)) = self.rows[i].drain.next(&mut payload) {
                let payload = &payload[..length];
                let record = Record {
                    kind,
                    source,
                    at,
                    payload,
                };
                record.append(&mut self.out);
                self.rows[i].frames += 1;
                any = true;
                if self.out.len() as u64 >= self.files.room() {
                    self.write();
                }
            }
            let row = &mut self.rows[i];
            let untold = std::mem::take(&mut row.untold);
            if untold > 0 {
                row.told += untold;
                let payload = &untold.to_le_bytes();
                Record {
                    kind: Kind::Lost,
                    source,
                    at: now,
                    payload,
                }
                .append(&mut self.out);
            }
        }
        let due = |marked| now.since(marked).is_some_and(|age| age >= MARK_EVERY);
        if any || self.marked.is_none_or(due) {
            self.marked = Some(now);
            let nanos = u64::try_from(STRAGGLE.as_nanos()).unwrap_or(0);
            let at = Monotonic::from_nanos(now.as_nanos().saturating_sub(nanos));
            Record {
                kind: Kind::Mark,
                source: NO_SOURCE,
                at,
                payload: &[],
            }
            .append(&mut self.out);
        }
        self.write();
    }

    /// Hands what is on its way to the system. What it refuses is lost, and counted.
    fn write(&mut self) {
        if self.out.is_empty() {
            return;
        }
        let outcome = self.files.write(&self.out);
        let (bytes, mut frames) = (self.out.len() as u64, 0);
        self.out.clear();
        for row in &mut self.rows {
            frames += row.frames;
            if outcome.is_err() {
                row.untold += row.frames + row.told;
            }
            (row.frames, row.told) = (0, 0);
        }
        self.count(|report| match &outcome {
            Ok(()) => {
                report.frames += frames;
                report.bytes += bytes;
            }
            Err(_) => report.lost += frames,
        });
        let full = outcome.is_ok() && self.files.room() == 0;
        let outcome = if full { self.files.next() } else { outcome };
        self.tell(&outcome);
    }

    fn count(&self, add: impl FnOnce(&mut Report)) {
        add(&mut self.report.lock().unwrap_or_else(PoisonError::into_inner));
    }

    fn tell(&self, outcome: &io::Result<()>) {
        self.count(|report| report.failing = outcome.as_ref().err().map(ToString::to_string));
    }
}

/// The files of the set.
struct Files {
    path: PathBuf,
    part_bytes: u64,
    size_limit: Option<u64>,
    header: PartHeader,
    file: File,
    /// Bytes of `file` that are whole records.
    length: u64,
}

impl Files {
    fn open(plan: Plan, session: u64) -> Result<Self, RecordingError> {
        let Plan {
            path,
            size_limit,
            header,
        } = plan;
        let size_limit = size_limit.map(|limit| limit.max(SIZE_LIMIT_MIN));
        let number = put_aside(&path)?;
        let header = PartHeader {
            number,
            session,
            header,
        };
        let begun = begin(&path, &header)
            .and_then(|begun| remove_oldest(&path, size_limit).map(|()| begun));
        let (file, length) = begun.map_err(|source| RecordingError::Unwritable {
            path: path.clone(),
            source,
        })?;
        Ok(Self {
            path,
            part_bytes: size_limit.map_or(u64::MAX, |limit| limit / PARTS),
            size_limit,
            header,
            file,
            length,
        })
    }

    /// Bytes that the file has room for.
    const fn room(&self) -> u64 {
        self.part_bytes.saturating_sub(self.length)
    }

    /// Appends whole records; a file that is then full is followed by the next.
    fn write(&mut self, records: &[u8]) -> io::Result<()> {
        if let Err(e) = self.file.write_all(records) {
            // Half a record in the middle would be skipped, too; but the room is needed.
            let _ = self.file.set_len(self.length);
            return Err(e);
        }
        self.length += records.len() as u64;
        Ok(())
    }

    /// The next file. Where there can be none, this one goes on beyond its size.
    fn next(&mut self) -> io::Result<()> {
        self.sync()?;
        let number = self.header.number;
        let full = set::full(&self.path, number);
        std::fs::rename(&self.path, &full)?;
        self.header.number = number.saturating_add(1);
        match begin(&self.path, &self.header) {
            Ok((file, length)) => (self.file, self.length) = (file, length),
            Err(e) => {
                self.header.number = number;
                let _ = std::fs::remove_file(&self.path);
                let _ = std::fs::rename(&full, &self.path);
                return Err(e);
            }
        }
        remove_oldest(&self.path, self.size_limit)
    }

    fn sync(&self) -> io::Result<()> {
        self.file.sync_data()
    }
}

/// A number that no other session has.
fn random() -> u64 {
    let text = std::fs::read_to_string("/proc/sys/kernel/random/uuid").unwrap_or_default();
    let digits: String = text
        .chars()
        .filter(char::is_ascii_hexdigit)
        .take(16)
        .collect();
    // Where there is no such file, a start within the same nanosecond after boot would have to be met.
    u64::from_str_radix(&digits, 16).unwrap_or_else(|_| Monotonic::read().as_nanos())
}

/// A new file with a header, on the disk. Its length.
fn begin(path: &Path, header: &PartHeader) -> io::Result<(File, u64)> {
    let mut file = OpenOptions::new()
        .append(true)
        .create_new(true)
        .open(path)?;
    flock(&file, FlockOperation::NonBlockingLockExclusive)?;
    let bytes = header.bytes();
    if let Err(e) = file.write_all(&bytes).and_then(|()| file.sync_data()) {
        let _ = std::fs::remove_file(path);
        return Err(e);
    }
    // The name of a new file is on the disk once its folder is.
    File::open(set::folder(path))?.sync_all()?;
    Ok((file, bytes.len() as u64))
}

/// Makes way for a new file. Returns its number.
fn put_aside(path: &Path) -> Result<u32, RecordingError> {
    let unwritable = |source| RecordingError::Unwritable {
        path: path.to_owned(),
        source,
    };
    let fulls = set::fulls(path).map_err(unwritable)?;
    let last = fulls.last().map_or(0, |(number, _)| *number);
    let opened = OpenOptions::new().read(true).append(true).open(path);
    let file = match opened {
        Ok(file) => file,
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(last.saturating_add(1)),
        Err(e) => return Err(unwritable(e)),
    };
    let nothing_of_ours = || RecordingError::NotARecording {
        path: path.to_owned(),
    };
    let length = file.metadata().map_err(unwritable)?;
    if !length.is_file() {
        return Err(nothing_of_ours());
    }
    let held = |_| RecordingError::Held {
        path: path.to_owned(),
    };
    flock(&file, FlockOperation::NonBlockingLockExclusive).map_err(held)?;
    if length.len() == 0 {
        std::fs::remove_file(path).map_err(unwritable)?;
        return Ok(last.saturating_add(1));
    }
    let number = match Part::open(&file).map_err(unwritable)?.0 {
        Beginning::Header(header, _) => header.number,
        // A power cut can leave a header half written; it is ours all the same.
        Beginning::Version(_) => last.saturating_add(1),
        Beginning::Damaged if begins_as_ours(path) => last.saturating_add(1),
        Beginning::Damaged => return Err(nothing_of_ours()),
    };
    let number = number.max(last.saturating_add(1));
    std::fs::rename(path, set::full(path, number)).map_err(unwritable)?;
    Ok(number.saturating_add(1))
}

fn begins_as_ours(path: &Path) -> bool {
    use std::io::Read as _;
    let mut bytes = Vec::new();
    let read =
        File::open(path).and_then(|file| file.take(MAGIC.len() as u64).read_to_end(&mut bytes));
    read.is_ok() && MAGIC.starts_with(&bytes)
}

/// Removes the oldest files, until there is room for another full one within the limit.
fn remove_oldest(path: &Path, size_limit: Option<u64>) -> io::Result<()> {
    let Some(limit) = size_limit else {
        return Ok(());
    };
    let mut files = Vec::new();
    for (_, file) in set::fulls(path)? {
        let bytes = file.metadata()?.len();
        files.push((file, bytes));
    }
    let mut all: u64 = files.iter().map(|(_, bytes)| bytes).sum();
    for (file, bytes) in files {
        if all <= limit - limit / PARTS {
            break;
        }
        std::fs::remove_file(file)?;
        all -= bytes;
    }
    Ok(())
}
