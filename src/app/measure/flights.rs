//! The flights that are made over a planet in memory and over a pack.

use crate::app::error::Failure;
use crate::app::measure::Progress;
use crate::app::measure::accuracy::{self, Effort};
use crate::app::measure::bench::Bench;
use crate::app::measure::flight::{self, Flight, Flown, Path};
use crate::app::measure::sheet::Sheet;
use crate::terrain::pack::PackInfo;
use crate::terrain::partition::{Partition, SEAM_HYSTERESIS_DEG, SEAM_LATITUDE_DEG};
use crate::terrain::planet::Planet;
use crate::terrain::surface::TileSource;
use crate::terrain::truth::Field;
use serde_json::{Value, json};

/// How far the ground around a flight is looked up, metres.
const REACH_M: f64 = 40_000.0;
/// Height above the ground of flights, metres, and their speed, metres a second.
const ABOVE_M: f64 = 100.0;
const SPEED_MPS: f64 = 60.0;

/// A flight: its name, path and seconds.
pub type Planned = (&'static str, Path, f64);

/// 100 m above the ground, to the north if nothing else is said.
const fn low(from_deg: (f64, f64)) -> Path {
    Path {
        from_deg,
        heading_deg: 0.0,
        speed_mps: SPEED_MPS,
        above_m: ABOVE_M,
        view: ((1024, 600), 60.0),
    }
}

/// To the north, a parallel being passed in the middle.
fn across((lat, lon): (f64, f64), seconds: f64) -> Path {
    let half_m = SPEED_MPS * seconds / 2.0;
    low((lat - half_m / 111_320.0, lon))
}

/// Whether a source reaches 45 N.
fn has_45_n(info: &PackInfo) -> bool {
    (info.bounds.south_deg..=info.bounds.north_deg).contains(&45.0)
}

/// Over the planet in memory, where it is mountainous: across the seam between partitions, and what is not flown over the
/// pack: across 45 N, and over mountains.
#[must_use]
pub fn over_planet(planet: &Planet, pack: Option<&PackInfo>, seconds: f64) -> Vec<Planned> {
    let place = |lat: f64| (lat, planet.mountains_deg(lat));
    let seam = place(SEAM_LATITUDE_DEG + SEAM_HYSTERESIS_DEG);
    let mut flights = vec![("across the seam to the cap", across(seam, seconds), seconds)];
    if !pack.is_some_and(has_45_n) {
        flights.push(("across 45 N", across(place(45.0), seconds), seconds));
    }
    if pack.is_none() {
        let path = over(accuracy::mountains(planet));
        flights.push(("over its mountains", path, seconds));
    }
    flights
}

fn over(from_deg: (f64, f64)) -> Path {
    Path {
        heading_deg: 215.0,
        ..low(from_deg)
    }
}

/// Over a pack: from its middle, and across 45 N where it reaches there.
#[must_use]
pub fn over_pack(info: &PackInfo, seconds: f64) -> Vec<Planned> {
    let (lat, lon) = accuracy::middle(info);
    let mut flights = vec![("from its middle", over((lat, lon)), seconds)];
    if has_45_n(info) {
        flights.push(("across 45 N", across((45.0, lon), seconds), seconds));
    }
    flights
}

/// Makes flights over a source.
///
/// # Errors
/// When the GPU refuses, a view does not settle, or a contact sheet cannot be written.
pub fn fly<S: TileSource>(
    bench: &mut Bench,
    source: &S,
    flights: Vec<Planned>,
    effort: &Effort,
    label: &str,
    progress: &Progress,
) -> Result<Vec<(String, Flown)>, Failure> {
    let mut out = Vec::new();
    for (name, path, seconds) in flights {
        let start = path.point(0.0);
        let partition = Partition::at(start.latitude.to_degrees(), None);
        let partition = if source.has(partition) {
            partition
        } else {
            Partition::Geographic
        };
        let name = format!("{label}: {name}");
        let flight = Flight {
            path,
            field: &Field::load(source, partition, &start, effort.reach_m.min(REACH_M)),
            seconds,
            lowest_m: source.info().height_min_m,
        };
        let mut sheet = effort.sheets.as_ref().map(|_| Sheet::default());
        let flown = flight::fly(bench, &flight, sheet.as_mut(), &mut |at, of| {
            progress.at(&name, at as usize, of as usize);
        })?;
        if let (Some(sheet), Some(folder)) = (sheet, &effort.sheets) {
            let file: Vec<&str> = name.split([' ', ':']).filter(|w| !w.is_empty()).collect();
            sheet.write(&folder.join(format!("flight-{}.png", file.join("-"))))?;
        }
        out.push((name, flown));
    }
    Ok(out)
}

/// The keys of flights.
pub fn report(document: &mut Value, flown: &[(String, Flown)]) {
    let most = |of: fn(&Flown) -> f64| flown.iter().map(|(_, f)| of(f)).fold(0.0, f64::max);
    document["pop_px_max"] = json!(most(|f| f.pop_px_max));
    document["swim_px_max"] = json!(most(|f| f.swim_px_max));
    let paths: Vec<Value> = flown.iter().map(|(name, f)| f.report(name)).collect();
    document["pop"] = json!({
        "paths": paths,
        "how": "60 m/s, 100 m above the ground, 30 frames a second, 1024x600, 60 deg, streamed with the quota of flight; \
                fixed points of the ground in the picture, 300 m apart within 25 km, hidden ones too; px_max: change of the \
                drawn height from one frame to the next, times focal length over distance; swim_px_max: how far a point is \
                drawn beside its vertical, likewise; holes: frames with one; late_frames: the finest level was missing",
    });
}
