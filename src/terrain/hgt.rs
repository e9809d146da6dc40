//! SRTM height files (.hgt): a square of big-endian i16 metres over one degree, rows from the north, edges shared with the
//! neighbours, -32768 where there is none. The name gives the south-west corner. Source: USGS/NASA, "SRTM Topography"
//! (SRTM_Topo.pdf, version 2.1 documentation, sections 3.1 and 3.2).

use crate::terrain::raster::{Crs, Geometry, Raster, Samples};

/// Posts along a side: 3" and 1".
const SIDES: [usize; 2] = [1201, 3601];

/// The south-west corner that a name such as `N50E014.hgt` or `s20w180.SRTMGL1.hgt` begins with, degrees north and east.
/// `None` if it begins otherwise or names no place on Earth.
#[must_use]
pub fn corner(name: &str) -> Option<(i32, i32)> {
    let number = |from: usize, to: usize| {
        let digits = name.get(from..to)?;
        let all = digits.bytes().all(|b| b.is_ascii_digit());
        all.then(|| digits.parse::<i32>().ok())?
    };
    let sign = |at: usize, plus: u8, minus: u8| match name.as_bytes().get(at)?.to_ascii_uppercase()
    {
        c if c == plus => Some(1),
        c if c == minus => Some(-1),
        _ => None,
    };
    let latitude = sign(0, b'N', b'S')? * number(1, 3)?;
    let longitude = sign(3, b'E', b'W')? * number(4, 7)?;
    let ends = name.as_bytes().get(7) == Some(&b'.');
    let on_earth = (-90..90).contains(&latitude) && (-180..180).contains(&longitude);
    (ends && on_earth).then_some((latitude, longitude))
}

/// The samples of a file with the given south-west corner; `None` if no .hgt has that many bytes.
#[must_use]
pub fn parse(bytes: &[u8], (latitude, longitude): (i32, i32)) -> Option<Raster> {
    let side = SIDES.into_iter().find(|s| 2 * s * s == bytes.len())?;
    let samples = bytes
        .chunks_exact(2)
        .map(|b| i16::from_be_bytes([b[0], b[1]]))
        .collect();
    let intervals = u32::try_from(side - 1).ok()?;
    let mut raster = Raster {
        geometry: Geometry {
            crs: Crs::Geographic,
            columns: side,
            rows: side,
            west: f64::from(longitude),
            north: f64::from(latitude + 1),
            step_east: 1.0 / f64::from(intervals),
            step_south: 1.0 / f64::from(intervals),
        },
        samples: Samples::Whole(samples),
    };
    raster.mark_voids(None);
    Some(raster)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_give_the_corner() {
        assert_eq!(corner("N50E014.hgt"), Some((50, 14)));
        assert_eq!(corner("s20w180.SRTMGL1.hgt"), Some((-20, -180)));
        for bad in [
            "",
            "N50E14.hgt",
            "N5xE014.hgt",
            "X50E014.hgt",
            "N95E014.hgt",
            "N50E200.hgt",
            "N50E0145.hgt",
            "N50E014",
            "N+5E014.hgt",
            "\u{e9}50E014.hgt",
        ] {
            assert_eq!(corner(bad), None, "{bad}");
        }
    }

    #[test]
    fn samples_are_big_endian_from_the_north_west() {
        let mut bytes = vec![0; 2 * 1201 * 1201];
        bytes[..4].copy_from_slice(&[0x01, 0x02, 0x80, 0x00]);
        let raster = parse(&bytes, (50, 14)).expect("1201 squared");
        let Samples::Whole(samples) = &raster.samples else {
            panic!("whole metres");
        };
        assert_eq!(&samples[..3], &[258, i16::MIN, 0]);
        assert!((raster.geometry.north - 51.0).abs() < 1e-12);
    }

    #[test]
    fn other_sizes_are_refused() {
        for size in [0, 2 * 1201 * 1201 - 1, 2 * 1201 * 1201 + 2, 2 * 1200 * 1200] {
            assert_eq!(parse(&vec![0; size], (0, 0)), None, "{size}");
        }
    }
}
