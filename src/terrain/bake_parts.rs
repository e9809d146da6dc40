//! A bake that can go on after an interruption: each row of degree cells is baked to a pack of its own in a folder, which
//! appears there only when it is whole; then they are joined ([`crate::terrain::join`]) and the folder is removed. The pack is
//! the same, byte for byte, as one baked at once.
//!
//! A file in the folder says of which bake the parts are: of the same options, region, and input files, each as long and as
//! old as it was. Parts of any other bake are refused.

use crate::terrain::bake::{BakeError, Job, Report, bake_region};
use crate::terrain::bake_plan::Plan;
use crate::terrain::join::{self, JoinError};
use crate::terrain::pack::{Pack, PostRect};
use std::fmt::Write as _;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// The file that says of which bake the parts are.
const LABEL: &str = "bake.txt";

/// Bakes in parts.
pub(crate) fn bake(
    job: &Job<'_>,
    plan: &Plan,
    region: Option<PostRect>,
    folder: &Path,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<Report, BakeError> {
    claim(job, plan, folder)?;
    let mut parts = Vec::new();
    let mut seams = Vec::new();
    for (latitude, band) in bands(plan, region) {
        let name = format!(
            "{}{:02}.pack",
            if latitude < 0 { 'S' } else { 'N' },
            latitude.unsigned_abs()
        );
        let part = folder.join(name);
        if Pack::open(&part).is_err() {
            match bake_region(job, plan, Some(band), &part, progress) {
                Ok(report) => seams.extend(report.seams),
                Err(BakeError::NothingInRegion) => continue,
                Err(e) => return Err(e),
            }
        }
        parts.push(part);
    }
    if parts.is_empty() {
        return Err(BakeError::NothingInRegion);
    }
    let joined = join::Job {
        packs: &parts,
        out: job.out,
        jobs: job.jobs,
        stop: job.stop,
    };
    let report = join::join(&joined, progress).map_err(|e| match e {
        JoinError::Stopped => BakeError::Stopped,
        JoinError::Output(path, e) => BakeError::Output(path, e),
        other => BakeError::Parts(other),
    })?;
    clear(folder, &parts).map_err(|e| BakeError::Output(folder.to_owned(), e))?;
    Ok(Report {
        info: report.info,
        seams,
    })
}

/// The rows of degree cells that the region has posts in.
fn bands(plan: &Plan, region: Option<PostRect>) -> Vec<(i32, PostRect)> {
    let posts = plan.grid.posts_per_degree.cast_signed();
    let turn = plan.grid.posts_around();
    let everywhere = PostRect {
        south: -plan.grid.row_max(),
        west: -turn,
        north: plan.grid.row_max(),
        east: turn,
    };
    let region = region.unwrap_or(everywhere);
    let rows = |r: &PostRect| (r.south.div_euclid(posts), r.north.div_euclid(posts));
    let shares = plan.shares(Some(&region));
    let covered = PostRect::around(shares.iter().filter_map(|s| s.own));
    let Some((first, last)) = covered.as_ref().map(rows) else {
        return Vec::new();
    };
    (first..=last)
        .filter_map(|latitude| {
            let row = PostRect {
                south: latitude * posts,
                north: latitude * posts + posts - 1,
                ..everywhere
            };
            Some((latitude, row.intersection(&region)?))
        })
        .collect()
}

/// Makes the folder this bake's, or refuses it if it is another's.
fn claim(job: &Job<'_>, plan: &Plan, folder: &Path) -> Result<(), BakeError> {
    let failed = |path: &Path| {
        let path = path.to_owned();
        move |e| BakeError::Output(path, e)
    };
    let mine = describe(job, plan)?;
    let label = folder.join(LABEL);
    match fs::read_to_string(&label) {
        Ok(theirs) if theirs == mine => return Ok(()),
        Ok(_) => return Err(BakeError::OtherParts(folder.to_owned())),
        Err(e) if e.kind() == io::ErrorKind::NotFound => {}
        Err(e) => return Err(failed(&label)(e)),
    }
    fs::create_dir_all(folder).map_err(failed(folder))?;
    if fs::read_dir(folder)
        .map_err(failed(folder))?
        .next()
        .is_some()
    {
        return Err(BakeError::OtherParts(folder.to_owned()));
    }
    fs::write(&label, mine).map_err(failed(&label))
}

/// All that the parts depend on.
fn describe(job: &Job<'_>, plan: &Plan) -> Result<String, BakeError> {
    let mut text = format!(
        "glasswing {}\nposts per degree {}, {:?}\n{:?}, region {:?}, {:?}\n",
        env!("CARGO_PKG_VERSION"),
        plan.grid.posts_per_degree,
        plan.scale,
        job.heights,
        job.region,
        job.plain,
    );
    for input in &plan.inputs {
        let about = fs::metadata(&input.path).and_then(|m| Ok((m.len(), m.modified()?)));
        let (bytes, modified) =
            about.map_err(|e| BakeError::Input(input.path.clone(), e.into()))?;
        // A string takes whatever is written to it.
        let _ = writeln!(text, "{} {bytes} {modified:?}", input.path.display());
    }
    Ok(text)
}

/// Removes the parts, and the folder if nothing else is in it.
fn clear(folder: &Path, parts: &[PathBuf]) -> io::Result<()> {
    for part in parts {
        fs::remove_file(part)?;
    }
    fs::remove_file(folder.join(LABEL))?;
    match fs::remove_dir(folder) {
        Err(e) if e.kind() != io::ErrorKind::DirectoryNotEmpty => Err(e),
        Ok(()) | Err(_) => Ok(()),
    }
}
