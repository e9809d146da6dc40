//! DTED levels 0, 1 and 2 (.dt0, .dt1, .dt2): profiles of heights from south to north, one after the other from west to
//! east, over one degree. Source: MIL-PRF-89020B (2000), sections 3.8 to 3.13 and figures 1 to 4.
//!
//! Heights are signed magnitude; some producers wrote two's complement, which shows by magnitudes that no place on Earth
//! has. Every profile has a checksum; a file in which all of them are zero was written without.

use crate::terrain::input::InputError;
use crate::terrain::raster::{Crs, Geometry, Raster, Samples};

/// The user header label.
const UHL_BYTES: usize = 80;
/// The data set identification.
const DSI_BYTES: usize = 648;
/// The accuracy description.
const ACC_BYTES: usize = 2700;
/// Before a profile's heights: recognition sentinel, block count, counts of longitude and latitude.
const PROFILE_HEAD_BYTES: usize = 8;
const CHECKSUM_BYTES: usize = 4;

/// Every bit set: the null value, -32767 in signed magnitude.
const NULL: u16 = 0xffff;

/// No magnitude on Earth is larger, metres.
const MAGNITUDE_MAX_M: u16 = 12_000;

/// Reads a DTED file from its bytes.
///
/// # Errors
/// If it is not DTED, damaged, or on another datum than WGS 84.
pub fn parse(bytes: &[u8]) -> Result<Raster, InputError> {
    let short = || InputError::Dted(format!("it ends after {} bytes", bytes.len()));
    let uhl = bytes.get(..UHL_BYTES).ok_or_else(short)?;
    if !uhl.starts_with(b"UHL1") {
        return Err(InputError::Dted("it does not begin with UHL1".to_owned()));
    }
    let heads = UHL_BYTES + DSI_BYTES + ACC_BYTES;
    let dsi = bytes
        .get(UHL_BYTES..UHL_BYTES + DSI_BYTES)
        .ok_or_else(short)?;
    check_datum(dsi)?;
    let geometry = geometry(uhl)?;
    let profile = PROFILE_HEAD_BYTES + 2 * geometry.rows + CHECKSUM_BYTES;
    let data = bytes.get(heads..).ok_or_else(short)?;
    if data.len() != geometry.columns * profile {
        return Err(InputError::Dted(format!(
            "it has {} bytes; {} profiles of {} heights take {}",
            bytes.len(),
            geometry.columns,
            geometry.rows,
            heads + geometry.columns * profile
        )));
    }
    let profiles: Vec<&[u8]> = data.chunks_exact(profile).collect();
    check_profiles(&profiles)?;
    let mut raster = Raster {
        geometry,
        samples: Samples::Whole(heights(&geometry, &profiles)?),
    };
    raster.mark_voids(None);
    Ok(raster)
}

/// DSI fields 14 and 15: heights above mean sea level or EGM96, positions on WGS 84.
fn check_datum(dsi: &[u8]) -> Result<(), InputError> {
    if !dsi.starts_with(b"DSI") {
        return Err(InputError::Dted("its DSI record is missing".to_owned()));
    }
    let (vertical, horizontal) = (text(&dsi[141..144]), text(&dsi[144..149]));
    if !matches!(horizontal.as_str(), "WGS84" | "") {
        return Err(InputError::Crs(format!("coordinates on {horizontal}")));
    }
    if !matches!(vertical.as_str(), "MSL" | "E96" | "") {
        return Err(InputError::Dted(format!(
            "its heights are above {vertical}, neither MSL nor E96"
        )));
    }
    Ok(())
}

fn text(field: &[u8]) -> String {
    String::from_utf8_lossy(field)
        .trim_matches([' ', '\0'])
        .to_owned()
}

/// UHL fields 3 to 6 and 10, 11: origin, intervals in tenths of arc seconds, numbers of lines and of points.
fn geometry(uhl: &[u8]) -> Result<Geometry, InputError> {
    let number = |from: usize, to: usize, what: &str| {
        let digits = text(&uhl[from..to]);
        digits
            .parse::<u32>()
            .map_err(|e| InputError::Dted(format!("its {what} is '{digits}': {e}")))
    };
    let angle = |from: usize, what: &str, letters: [u8; 2]| {
        let degrees = f64::from(number(from, from + 3, what)?)
            + f64::from(number(from + 3, from + 5, what)?) / 60.0
            + f64::from(number(from + 5, from + 7, what)?) / 3600.0;
        match uhl[from + 7] {
            letter if letter == letters[0] => Ok(degrees),
            letter if letter == letters[1] => Ok(-degrees),
            _ => Err(InputError::Dted(format!("its {what} has no hemisphere"))),
        }
    };
    let west = angle(4, "longitude of origin", [b'E', b'W'])?;
    let south = angle(12, "latitude of origin", [b'N', b'S'])?;
    let tenths_to_deg = 1.0 / 36_000.0;
    let step_east = f64::from(number(20, 24, "longitude interval")?) * tenths_to_deg;
    let step_south = f64::from(number(24, 28, "latitude interval")?) * tenths_to_deg;
    let columns = number(47, 51, "number of longitude lines")?;
    let rows = number(51, 55, "number of latitude points")?;
    let north = step_south.mul_add(f64::from(rows.max(1) - 1), south);
    let east = step_east.mul_add(f64::from(columns.max(1) - 1), west);
    let one_degree = |from: f64, to: f64| (0.0..1.01).contains(&(to - from));
    let sound = columns >= 2
        && rows >= 2
        && step_east > 0.0
        && step_south > 0.0
        && one_degree(west, east)
        && one_degree(south, north)
        && south >= -90.0
        && north <= 90.0 + 1e-9
        && (-180.0..=180.0).contains(&west);
    if !sound {
        return Err(InputError::Dted(format!(
            "its header names no cell of a degree: {columns} x {rows} points from {south} N {west} E"
        )));
    }
    Ok(Geometry {
        crs: Crs::Geographic,
        columns: columns as usize,
        rows: rows as usize,
        west: if west < 180.0 { west } else { -180.0 },
        north,
        step_east,
        step_south,
    })
}

/// Sentinels, and checksums where they were written: the sum of all bytes before them.
fn check_profiles(profiles: &[&[u8]]) -> Result<(), InputError> {
    let split = |profile: &&'_ [u8]| {
        let (body, sum) = profile.split_at(profile.len() - CHECKSUM_BYTES);
        let wanted: u32 = body.iter().map(|b| u32::from(*b)).sum();
        (wanted, u32::from_be_bytes([sum[0], sum[1], sum[2], sum[3]]))
    };
    let unchecked = profiles.iter().all(|p| split(p).1 == 0);
    for (at, profile) in profiles.iter().enumerate() {
        let (wanted, there) = split(profile);
        if profile[0] != 0xaa || (!unchecked && wanted != there) {
            return Err(InputError::Dted(format!(
                "its profile {} is damaged",
                at + 1
            )));
        }
    }
    Ok(())
}

/// From profiles to rows from the north.
fn heights(geometry: &Geometry, profiles: &[&[u8]]) -> Result<Vec<i16>, InputError> {
    let raw = |profile: &[u8], row: usize| {
        let at = PROFILE_HEAD_BYTES + 2 * row;
        u16::from_be_bytes([profile[at], profile[at + 1]])
    };
    let all = || {
        profiles
            .iter()
            .flat_map(|p| (0..geometry.rows).map(|row| raw(p, row)))
    };
    let absurd = |h: u16| h != NULL && (h & 0x7fff) > MAGNITUDE_MAX_M;
    let complement = all().any(absurd);
    if complement {
        let known = |h: u16| !matches!(h, NULL | 0x8000 | 0x8001);
        if all().any(|h| known(h) && h.cast_signed().unsigned_abs() > MAGNITUDE_MAX_M) {
            let why = "its heights are those of no place on Earth";
            return Err(InputError::Dted(why.to_owned()));
        }
    }
    let height = |h: u16| match h {
        NULL if !complement => i16::MIN,
        _ if complement => h.cast_signed(),
        _ if h & 0x8000 != 0 => -(h & 0x7fff).cast_signed(),
        _ => h.cast_signed(),
    };
    let mut samples = Vec::with_capacity(geometry.columns * geometry.rows);
    for row in (0..geometry.rows).rev() {
        samples.extend(profiles.iter().map(|p| height(raw(p, row))));
    }
    Ok(samples)
}
