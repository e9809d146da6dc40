//! The fault matrix: every shown parameter, every fault, every protocol that can carry it. No value that is not true is
//! shown past the fault's deadline. The table is written to `target/tmp/fault-matrix` (`./dev matrix` says where).
//!
//! A shown value is *wrong* when it was not true, to what its protocol can resolve, at any moment as long ago as the
//! parameter may be old, and a picture. It may be shown until the fault's deadline: the parameter's greatest age (attitude
//! 0.3 s, air data 2 s, position 1 s), for what stands still the time that finding it takes; and one picture.
//!
//! A calm sensor that stops alone (heading, altitude, vertical and ground speed, track, temperature, wind) is no lie before the
//! truth has left it: it is wrong from when it misleads by more than `matrix_support::misleads` says (10 degrees, 30 m, ...),
//! and must be found within the same deadline from then. Everything moves in the flight, so that all of them are left.

mod matrix_support;
mod support;

use glasswing::bench::encode;
use glasswing::bench::fault::Kind;
use glasswing::proto::Protocol;
use glasswing::sampled::Invalid;
use glasswing::signal::Parameter;
use glasswing::time::Monotonic;
use matrix_support::flight::Flight;
use matrix_support::{Cell, REORDERING, SHOWN, TROUBLES, fly, table};
use std::sync::Mutex;

/// What one source alone can never tell (`matrix_support::limit` says why); there may be no more.
const IMPOSSIBLE: [(Parameter, &[Protocol]); 2] = [
    (
        Parameter::BaroSetting,
        &[Protocol::DynonSkyView, Protocol::GarminG3x, Protocol::Nmea],
    ),
    (Parameter::WindSpeed, &[Protocol::DynonSkyView]),
];

/// All cells of one protocol.
fn column(flight: &Flight, protocol: Protocol) -> Vec<Cell> {
    let encoder = encode::encoder(protocol);
    let carried: Vec<Parameter> = SHOWN
        .into_iter()
        .filter(|p| encoder.carries(*p).is_some())
        .collect();
    let mut cells = Vec::new();
    for trouble in TROUBLES.into_iter().chain([REORDERING]) {
        if trouble.is_whole {
            cells.extend(fly(flight, protocol, trouble, &carried));
            continue;
        }
        for parameter in &carried {
            if trouble.kind.is_possible(encoder.as_ref(), *parameter) {
                cells.extend(fly(flight, protocol, trouble, &[*parameter]));
            }
        }
    }
    cells
}

#[test]
fn no_fault_shows_a_wrong_value() {
    let flight = Flight::new();
    let protocols = Mutex::new(if support::is_emulated() {
        vec![Protocol::CanFix, Protocol::GarminG3x]
    } else {
        Protocol::ALL.to_vec()
    });
    let all = Mutex::new(Vec::new());
    let began = Monotonic::read();
    std::thread::scope(|scope| {
        let threads = std::thread::available_parallelism().map_or(2, std::num::NonZero::get);
        for _ in 0..threads {
            scope.spawn(|| {
                loop {
                    let Some(protocol) = protocols.lock().expect("no panic").pop() else {
                        return;
                    };
                    let cells = column(&flight, protocol);
                    all.lock().expect("no panic").extend(cells);
                }
            });
        }
    });
    let mut cells = all.into_inner().expect("no panic");
    cells.sort_by_key(|c| (c.parameter, c.trouble.name, c.protocol.name()));
    let folder = support::scratch_dir("fault-matrix");
    std::fs::write(folder.join("matrix.csv"), table::csv(&cells)).expect("written");
    std::fs::write(folder.join("matrix.md"), table::markdown(&cells)).expect("written");
    println!(
        "{} cells in {:.0} s: {}",
        cells.len(),
        Monotonic::read()
            .since(began)
            .unwrap_or_default()
            .as_secs_f64(),
        folder.join("matrix.md").display()
    );
    for cell in cells.iter().filter(|c| c.wrong > 0 && c.limit.is_some()) {
        let (p, t, proto) = (cell.parameter, cell.trouble.name, cell.protocol);
        let reason = cell.limit.unwrap_or_default();
        println!(
            "{} under {t} over {}: {reason}",
            p.spec().name,
            proto.name()
        );
        let is_named = IMPOSSIBLE
            .iter()
            .any(|(q, all)| *q == p && all.contains(&proto));
        assert!(is_named, "{p:?} under {t} over {proto:?}: not found");
    }
    let wrong: Vec<String> = cells
        .iter()
        .filter(|c| c.wrong > 0 && c.limit.is_none())
        .map(|c| {
            let (p, t, proto) = (c.parameter.spec().name, c.trouble.name, c.protocol.name());
            format!(
                "{p} under {t} over {proto}: {} pictures, off by {:.1}",
                c.wrong, c.worst
            )
        })
        .collect();
    assert!(
        wrong.is_empty(),
        "{} shown as good:\n{}",
        wrong.len(),
        wrong.join("\n")
    );
    found_and_back(&cells);
}

/// Every fault of a value was noticed, and every value came back in time.
fn found_and_back(cells: &[Cell]) {
    for cell in cells {
        // A setting may be twenty seconds old, and what is constant does not freeze.
        let is_harmless = !matches!(
            cell.trouble.kind,
            Kind::Jump | Kind::Nan | Kind::Sentinel | Kind::OutOfRange
        ) || cell.limit.is_some();
        let name = cell.parameter.spec().name;
        let what = format!(
            "{name} under {} over {}",
            cell.trouble.name,
            cell.protocol.name()
        );
        // Garmin's simple text doubts a ground speed that another message gives.
        let is_open = cell.limit.is_some() || cell.said == Some(Invalid::Doubtful);
        assert!(is_harmless || cell.after.is_some(), "{what}: never flagged");
        assert!(
            is_open || cell.back_after.is_some(),
            "{what}: never good again"
        );
    }
}
