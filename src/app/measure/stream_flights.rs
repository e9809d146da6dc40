//! The flights of `measure streaming`, frame by frame.

use crate::app::measure::bench::{self, Dice};
use crate::app::measure::flight::Path;
use crate::geo::{Camera, WGS84_B_M};
use crate::terrain::pack::PackInfo;
use crate::terrain::partition::Partition;
use crate::terrain::surface::TileSource;
use crate::terrain::truth::Field;

/// Frames a second of flight.
pub const RATE_HZ: f64 = super::flight::RATE_HZ;
/// Frames from one leap to the next: 5 s.
pub const LEAP_FRAMES: usize = 150;
/// Size of the pictures, pixels.
const SIZE: (u32, u32) = (640, 360);
/// 300 and 900 km/h, metres a second.
const SLOW_MPS: f64 = 300.0 / 3.6;
const FAST_MPS: f64 = 900.0 / 3.6;
/// Bank of the fast flight's turns, degrees, and how long each lasts, seconds.
const BANK_DEG: f64 = 60.0;
const TURN_S: f64 = 12.0;
/// Acceleration of free fall, m/s2.
const G: f64 = 9.806_65;
/// How far the ground around a flight is looked up, metres.
const FIELD_M: f64 = 20_000.0;

/// A flight: a view for each frame.
#[derive(Clone, Debug)]
pub struct Route {
    /// What it is called.
    pub name: &'static str,
    /// The views.
    pub cameras: Vec<Camera>,
    /// Frames that are the first in a place of which nothing can be resident.
    pub leaps: Vec<usize>,
    /// Frames somewhere else altogether, before those.
    pub aways: Vec<usize>,
}

impl Route {
    fn straight(name: &'static str, cameras: Vec<Camera>) -> Self {
        Self {
            name,
            cameras,
            leaps: Vec::new(),
            aways: Vec::new(),
        }
    }
}

/// 300 km/h at 100 m, 900 km/h at 3 km with turns, and a leap every 5 s; from a place, degrees north and east.
#[must_use]
pub fn all<S: TileSource>(source: &S, middle: (f64, f64), seconds: f64) -> Vec<Route> {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "some thousand frames"
    )]
    let frames = (seconds * RATE_HZ).ceil() as u32;
    vec![
        Route::straight("300 km/h at 100 m", low(source, middle, frames)),
        Route::straight(
            "900 km/h at 3 km with turns",
            turning(source, middle, frames),
        ),
        leaping(source.info(), frames),
    ]
}

/// Along the ground.
fn low<S: TileSource>(source: &S, middle: (f64, f64), frames: u32) -> Vec<Camera> {
    let path = Path {
        from_deg: middle,
        heading_deg: 215.0,
        speed_mps: SLOW_MPS,
        above_m: 100.0,
        view: (SIZE, 60.0),
    };
    let reach_m = FIELD_M.min(SLOW_MPS * f64::from(frames) / RATE_HZ + 5000.0);
    let field = Field::load(source, Partition::Geographic, &path.point(0.0), reach_m);
    (0..frames)
        .map(|frame| path.camera(&field, frame))
        .collect()
}

/// Level, in turns to the right and to the left, each begun and ended with wings level for a second.
fn turning<S: TileSource>(source: &S, middle: (f64, f64), frames: u32) -> Vec<Camera> {
    let ground_m = ground_m(source, middle);
    let (mut lat, mut lon) = middle;
    let mut heading_deg = 215.0_f64;
    let rate_deg = (G * BANK_DEG.to_radians().tan() / FAST_MPS).to_degrees();
    let degree_m = WGS84_B_M.to_radians();
    (0..frames)
        .map(|frame| {
            let t = f64::from(frame) / RATE_HZ;
            let within = t.rem_euclid(TURN_S);
            let banked = (within.min(TURN_S - within)).clamp(0.0, 1.0);
            let side = if t.rem_euclid(2.0 * TURN_S) < TURN_S {
                1.0
            } else {
                -1.0
            };
            let camera = bench::camera(
                (lat, lon, ground_m + 3000.0),
                (
                    heading_deg.rem_euclid(360.0),
                    -6.0,
                    side * banked * BANK_DEG,
                ),
                60.0,
                SIZE,
            );
            heading_deg += side * banked * rate_deg / RATE_HZ;
            let (sin, cos) = heading_deg.to_radians().sin_cos();
            lat += FAST_MPS / RATE_HZ * cos / degree_m;
            lon += FAST_MPS / RATE_HZ * sin / degree_m / lat.to_radians().cos().max(0.01);
            camera
        })
        .collect()
}

/// Height of the ground at a place above the ellipsoid, metres; 0 where there is none.
fn ground_m<S: TileSource>(source: &S, (lat, lon): (f64, f64)) -> f64 {
    let at = crate::geo::Geodetic::from_degrees(lat, lon, 0.0);
    let field = Field::load(source, Partition::Geographic, &at, 1000.0);
    field.ground(&at).map_or(0.0, |ground| ground.height_m)
}

/// From place to place among what a source covers, with a frame on the other side of the Earth before each.
fn leaping(info: &PackInfo, frames: u32) -> Route {
    let mut route = Route::straight("a teleport every 5 s", Vec::new());
    let view = |(lat, lon): (f64, f64)| {
        let lon = (lon + 180.0).rem_euclid(360.0) - 180.0;
        bench::camera(
            (lat, lon, info.height_max_m + 500.0),
            (215.0, -10.0, 0.0),
            60.0,
            SIZE,
        )
    };
    let b = info.bounds;
    for frame in 0..frames as usize {
        let within = frame % LEAP_FRAMES;
        let mut dice = Dice::of(0x1ea9, frame / LEAP_FRAMES);
        // Within the geographic partition, so that all leaps mean the same.
        let lat = dice.between(b.south_deg.max(-65.0), b.north_deg.min(65.0));
        let place = (lat, dice.between(b.west_deg, b.east_deg));
        match within {
            0 => {
                route.aways.push(frame);
                route.cameras.push(view((-place.0, place.1 + 180.0)));
            }
            at => {
                if at == 1 {
                    route.leaps.push(frame);
                }
                route.cameras.push(view(place));
            }
        }
    }
    route
}

/// To and fro across what a source covers, at most 100 km either way, 100 m above the ground at 300 km/h, ten frames for
/// each second.
pub fn to_and_fro<S: TileSource>(
    source: &S,
    middle: (f64, f64),
    hours: f64,
) -> impl Iterator<Item = Camera> {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "some ten thousand frames"
    )]
    let frames = (hours * 36_000.0).ceil() as u32;
    let b = source.info().bounds;
    let half_deg = (b.north_deg - b.south_deg).min(b.east_deg - b.west_deg) / 2.0;
    let reach_m = (half_deg * WGS84_B_M.to_radians() * 0.6).min(100_000.0);
    let at = crate::geo::Geodetic::from_degrees(middle.0, middle.1, 0.0);
    let field = Field::load(source, Partition::Geographic, &at, reach_m + 1000.0);
    (0..frames).map(move |frame| {
        let along = SLOW_MPS * f64::from(frame) / 10.0;
        let within = along.rem_euclid(4.0 * reach_m);
        let (way_m, heading) = if within < 2.0 * reach_m {
            (within - reach_m, 30.0)
        } else {
            (3.0 * reach_m - within, 210.0)
        };
        let path = Path {
            from_deg: middle,
            heading_deg: 30.0,
            speed_mps: 1.0,
            above_m: 100.0,
            view: (SIZE, 60.0),
        };
        let at = path.point(way_m);
        let ground_m = field.ground(&at).map_or(0.0, |ground| ground.height_m);
        bench::camera(
            (
                at.latitude.to_degrees(),
                at.longitude.to_degrees(),
                ground_m + 100.0,
            ),
            (heading, -3.0, 0.0),
            60.0,
            SIZE,
        )
    })
}
