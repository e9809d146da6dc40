//! Frames to files: PNG pictures and `frames.csv`, the state that each picture shows, written by a thread of their own.
//!
//! The frame loop hands over a filled buffer and takes an empty one; it never waits. When the disk or the encoder cannot
//! keep up, a frame is left out and counted, and the next one is written: nothing about flying changes.
//!
//! `frames.csv` has one row per picture: `frame` (number since the start, from 0), `file`, `time_s` (since the start),
//! `monotonic_ns` (CLOCK_MONOTONIC at which ages were judged), then for every parameter its value in the unit that its
//! name ends in, or `!reason` where none may be shown; then, for attitude, air data and position, the age in seconds of
//! what was shown, empty when nothing was.

use crate::app::error::{Failure, Kind};
use crate::app::picture::{Effort, Size, write_png};
use crate::signal::Parameter;
use crate::state::FlightState;
use crate::time::Monotonic;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// Pictures on their way to the disk: a quarter of a second at 30 Hz.
const BUFFERS: usize = 8;

/// What is written of one frame beside its picture.
#[derive(Clone, Copy, Debug)]
pub struct FrameRow {
    /// Number since the start, from 0.
    pub number: u64,
    /// The time at which ages were judged.
    pub now: Monotonic,
    /// The state shown.
    pub state: FlightState,
}

struct Job {
    rgba: Vec<u8>,
    row: FrameRow,
}

/// The parameters whose ages are written: one for each group that a frame may not mix up.
const AGES: [(&str, Parameter); 3] = [
    ("attitude_age_s", Parameter::Pitch),
    ("air_data_age_s", Parameter::CalibratedAirspeed),
    ("position_age_s", Parameter::Latitude),
];

/// The hand-over to the writing thread.
#[derive(Debug)]
pub struct FrameWriter {
    filled: rtrb::Producer<Job>,
    empty: rtrb::Consumer<Vec<u8>>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<Result<u64, Failure>>>,
    /// Frames left out because no buffer was free.
    pub left_out: u64,
}

impl std::fmt::Debug for Job {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Job")
            .field("number", &self.row.number)
            .finish_non_exhaustive()
    }
}

impl FrameWriter {
    /// Starts writing into `folder`, which is made if it is not there. Frames of an earlier run are removed, so that the
    /// folder holds one run. All buffers are allocated here.
    ///
    /// # Errors
    /// When the folder or `frames.csv` in it cannot be made.
    pub fn start(folder: &Path, size: Size, start: Monotonic) -> Result<Self, Failure> {
        let refused = |e: std::io::Error| {
            Failure::new(
                Kind::Input,
                folder.display(),
                "frames cannot be written there",
                "give a folder that can be written to",
            )
            .caused_by(e)
        };
        std::fs::create_dir_all(folder).map_err(refused)?;
        for old in pictures(folder)? {
            std::fs::remove_file(old).map_err(refused)?;
        }
        let csv = File::create(folder.join("frames.csv")).map_err(refused)?;
        let (filled, jobs) = rtrb::RingBuffer::new(BUFFERS);
        let (mut give_back, empty) = rtrb::RingBuffer::new(BUFFERS);
        for _ in 0..BUFFERS {
            let _ = give_back.push(vec![0; size.rgba_bytes()]);
        }
        let stop = Arc::new(AtomicBool::new(false));
        let writer = Writer {
            folder: folder.to_owned(),
            csv: BufWriter::new(csv),
            size,
            start,
            jobs,
            give_back,
            stop: Arc::clone(&stop),
        };
        let thread = std::thread::Builder::new()
            .name("frames".into())
            .spawn(|| writer.run())
            .map_err(refused)?;
        Ok(Self {
            filled,
            empty,
            stop,
            thread: Some(thread),
            left_out: 0,
        })
    }

    /// Writes one frame if a buffer is free: `fill` gets a buffer of the picture's size to put RGBA rows into. Returns
    /// whether it was taken. Neither blocks nor allocates.
    pub fn write(&mut self, row: FrameRow, fill: impl FnOnce(&mut [u8])) -> bool {
        let Ok(mut rgba) = self.empty.pop() else {
            self.left_out += 1;
            return false;
        };
        fill(&mut rgba);
        // As many places as buffers: there is always room.
        let pushed = self.filled.push(Job { rgba, row }).is_ok();
        if let Some(thread) = &self.thread {
            thread.thread().unpark();
        }
        pushed
    }

    /// The same, waiting for a buffer: for pictures that are made at no particular time.
    pub fn write_patiently(&mut self, row: FrameRow, fill: impl FnOnce(&mut [u8])) {
        while self.empty.is_empty() {
            std::thread::sleep(Duration::from_millis(1));
        }
        self.write(row, fill);
    }

    /// Writes what is on its way and ends. Returns how many frames were written.
    ///
    /// # Errors
    /// The first failure to write, if there was one.
    pub fn finish(mut self) -> Result<u64, Failure> {
        self.stop.store(true, Ordering::Release);
        let Some(thread) = self.thread.take() else {
            return Ok(0);
        };
        thread.thread().unpark();
        thread.join().unwrap_or_else(|_| {
            Err(Failure::new(
                Kind::Other,
                "the frame writer",
                "ended by a fault",
                "report this",
            ))
        })
    }
}

/// The frames that a run has written into a folder, in order.
///
/// # Errors
/// When the folder cannot be read.
pub fn pictures(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let entries = std::fs::read_dir(folder).map_err(|e| {
        Failure::new(
            Kind::Input,
            folder.display(),
            "cannot be read",
            "give a folder",
        )
        .caused_by(e)
    })?;
    let is_frame = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let number = name
            .strip_prefix("frame-")
            .and_then(|rest| rest.strip_suffix(".png"));
        number.is_some_and(|n| n.len() >= 6 && n.bytes().all(|b| b.is_ascii_digit()))
    };
    let mut frames: Vec<PathBuf> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(is_frame)
        .collect();
    frames.sort();
    Ok(frames)
}

struct Writer {
    folder: PathBuf,
    csv: BufWriter<File>,
    size: Size,
    start: Monotonic,
    jobs: rtrb::Consumer<Job>,
    give_back: rtrb::Producer<Vec<u8>>,
    stop: Arc<AtomicBool>,
}

impl Writer {
    fn run(mut self) -> Result<u64, Failure> {
        let mut rgb = Vec::with_capacity(self.size.rgba_bytes());
        let mut written = 0;
        let mut outcome = self.header();
        loop {
            // Read before the queue: what was queued before the stop is seen after it.
            let stopping = self.stop.load(Ordering::Acquire);
            while let Ok(job) = self.jobs.pop() {
                if outcome.is_ok() {
                    outcome = self.write(&job, &mut rgb);
                    written += u64::from(outcome.is_ok());
                }
                let _ = self.give_back.push(job.rgba);
            }
            if stopping {
                break;
            }
            std::thread::park();
        }
        outcome?;
        self.csv.flush().map_err(|e| self.refused(e))?;
        Ok(written)
    }

    fn refused(&self, e: std::io::Error) -> Failure {
        let file = self.folder.join("frames.csv");
        Failure::new(
            Kind::Other,
            file.display(),
            "cannot be written",
            "make room on the disk",
        )
        .caused_by(e)
    }

    fn header(&mut self) -> Result<(), Failure> {
        let mut line = String::from("frame,file,time_s,monotonic_ns");
        for p in Parameter::ALL {
            line.push(',');
            line.push_str(p.spec().name);
        }
        for (name, _) in AGES {
            line.push(',');
            line.push_str(name);
        }
        writeln!(self.csv, "{line}").map_err(|e| self.refused(e))
    }

    fn write(&mut self, job: &Job, rgb: &mut Vec<u8>) -> Result<(), Failure> {
        let FrameRow { number, now, state } = job.row;
        let file = format!("frame-{number:06}.png");
        write_png(
            &self.folder.join(&file),
            self.size,
            &job.rgba,
            Effort::Fast,
            rgb,
        )?;
        let time_s = now.since(self.start).unwrap_or_default().as_secs_f64();
        let mut line = format!("{number},{file},{time_s:.6},{}", now.as_nanos());
        for p in Parameter::ALL {
            line.push(',');
            match state.read(*p, now) {
                // Rust prints the shortest digits that read back as the same number.
                Ok(value) => line.push_str(&value.to_string()),
                Err(reason) => {
                    line.push('!');
                    line.push_str(reason.name());
                }
            }
        }
        for (_, p) in AGES {
            line.push(',');
            if let (Ok(_), Some(age)) = (state.read(p, now), state.age(p, now)) {
                line.push_str(&format!("{:.6}", age.as_secs_f64()));
            }
        }
        writeln!(self.csv, "{line}").map_err(|e| self.refused(e))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampled::Sampled;
    use crate::signal::SourceId;

    #[test]
    fn frames_and_rows_arrive_and_missing_values_say_why() {
        let folder = std::env::temp_dir().join(format!("glasswing-frames-{}", std::process::id()));
        let size = Size {
            width_px: 4,
            height_px: 2,
        };
        let start = Monotonic::from_nanos(5_000_000_000);
        let mut writer = FrameWriter::start(&folder, size, start).expect("starts");
        let mut state = FlightState::empty();
        state.set(Parameter::Pitch, Sampled::good(0.125, start), SourceId(0));
        let now = start.plus(Duration::from_millis(100));
        assert!(
            writer.write(
                FrameRow {
                    number: 0,
                    now,
                    state
                },
                |b| b.fill(200)
            ),
            "room for one"
        );
        assert_eq!(writer.finish().expect("writes"), 1);
        let csv = std::fs::read_to_string(folder.join("frames.csv")).expect("is there");
        let rows: Vec<Vec<&str>> = csv.lines().map(|l| l.split(',').collect()).collect();
        let column = |name: &str| rows[0].iter().position(|n| *n == name).expect(name);
        assert_eq!(rows[1][column("pitch_rad")], "0.125");
        assert_eq!(rows[1][column("roll_rad")], "!never-received");
        assert_eq!(rows[1][column("attitude_age_s")], "0.100000");
        assert_eq!(rows[1][column("position_age_s")], "");
        assert!(
            folder
                .join("frame-000000.png")
                .metadata()
                .expect("is there")
                .len()
                > 60,
            "a PNG"
        );
        std::fs::remove_dir_all(folder).expect("removed");
    }
}
