//! Compressed .hgt files: a .zip that holds one, and .hgt.gz.

use crate::terrain::input::InputError;
use crate::terrain::pack_format::CRC;
use miniz_oxide::inflate::decompress_to_vec_with_limit;
use std::io::{Cursor, Read};

/// No .hgt is larger, bytes: 3601 posts squared. One byte more is read so that a larger one is seen to be larger.
pub const HGT_BYTES_MAX: usize = 2 * 3601 * 3601;

/// The .hgt in a zip archive: its name without folders, and its bytes.
///
/// # Errors
/// If the archive is damaged or does not hold exactly one .hgt.
pub fn hgt_in_zip(archive: Vec<u8>) -> Result<(String, Vec<u8>), InputError> {
    let mut zip = zip::ZipArchive::new(Cursor::new(archive)).map_err(InputError::Zip)?;
    let mut found = Vec::new();
    for at in 0..zip.len() {
        let file = zip.by_index(at).map_err(InputError::Zip)?;
        let path = file.name().map_err(InputError::Zip)?.into_owned();
        let name = path.rsplit(['/', '\\']).next().unwrap_or("").to_owned();
        // macOS puts a companion file of resource forks beside each real one.
        if name.to_ascii_lowercase().ends_with(".hgt") && !name.starts_with("._") {
            found.push((at, name));
        }
    }
    let (at, name) = match (found.pop(), found.len()) {
        (None, _) => return Err(InputError::ZipWithoutHgt),
        (Some(only), 0) => only,
        (Some(_), others) => return Err(InputError::ZipWithMany(others + 1)),
    };
    let file = zip.by_index(at).map_err(InputError::Zip)?;
    let mut bytes = Vec::new();
    file.take(HGT_BYTES_MAX as u64 + 1)
        .read_to_end(&mut bytes)
        .map_err(|e| InputError::Zip(e.into()))?;
    Ok((name, bytes))
}

/// The bytes in a gzip file (RFC 1952) of one member; what is longer than `bytes_max` is cut one byte behind that.
///
/// # Errors
/// If it is damaged.
pub fn in_gzip(file: &[u8], bytes_max: usize) -> Result<Vec<u8>, InputError> {
    let body = gzip_body(file).ok_or(InputError::Gzip)?;
    let (deflated, tail) = body
        .split_at_checked(body.len().saturating_sub(8))
        .ok_or(InputError::Gzip)?;
    let bytes = match decompress_to_vec_with_limit(deflated, bytes_max + 1) {
        Ok(bytes) => bytes,
        // Too large: what there is tells the size check so.
        Err(e) if e.output.len() > bytes_max => e.output,
        Err(_) => return Err(InputError::Gzip),
    };
    let length = u32::try_from(bytes.len()).unwrap_or(0);
    let sound = tail.len() == 8
        && tail[..4] == CRC.checksum(&bytes).to_le_bytes()
        && tail[4..] == length.to_le_bytes();
    if sound || bytes.len() > bytes_max {
        Ok(bytes)
    } else {
        Err(InputError::Gzip)
    }
}

/// What follows the header: the deflate stream and 8 bytes of CRC and length.
fn gzip_body(file: &[u8]) -> Option<&[u8]> {
    const FHCRC: u8 = 2;
    const FEXTRA: u8 = 4;
    const FNAME: u8 = 8;
    const FCOMMENT: u8 = 16;
    let (head, mut rest) = file.split_first_chunk::<10>()?;
    let [0x1f, 0x8b, 8, flags, ..] = *head else {
        return None;
    };
    // Reserved flags announce fields that this reader would take for data.
    if flags & 0xe0 != 0 {
        return None;
    }
    if flags & FEXTRA != 0 {
        let (length, tail) = rest.split_first_chunk::<2>()?;
        rest = tail.get(usize::from(u16::from_le_bytes(*length))..)?;
    }
    for text in [FNAME, FCOMMENT] {
        if flags & text != 0 {
            let end = rest.iter().position(|b| *b == 0)?;
            rest = rest.get(end + 1..)?;
        }
    }
    if flags & FHCRC != 0 {
        rest = rest.get(2..)?;
    }
    Some(rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `printf glasswing | gzip -n`, by GNU gzip 1.12.
    const GZIPPED: [u8; 29] = [
        0x1f, 0x8b, 0x08, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x03, 0x4b, 0xcf, 0x49, 0x2c, 0x2e,
        0x2e, 0xcf, 0xcc, 0x4b, 0x07, 0x00, 0x4e, 0x35, 0x0c, 0xde, 0x09, 0x00, 0x00, 0x00,
    ];

    #[test]
    fn gzip_is_read_and_its_damage_seen() {
        let file = GZIPPED.to_vec();
        assert_eq!(in_gzip(&file, HGT_BYTES_MAX).expect("sound"), b"glasswing");
        // The same with a stored name.
        let mut named = file.clone();
        named[3] = 8;
        named.splice(10..10, *b"N50E014.hgt\0");
        assert_eq!(in_gzip(&named, HGT_BYTES_MAX).expect("sound"), b"glasswing");
        for at in 0..file.len() {
            // Time, extra flags and operating system (bytes 4 to 9) carry no data, nor do the bits that fill the last byte
            // of the deflate stream.
            if (4..10).contains(&at) || at == 20 {
                continue;
            }
            let mut bad = file.clone();
            bad[at] ^= 0x40;
            assert!(in_gzip(&bad, HGT_BYTES_MAX).is_err(), "byte {at}");
        }
        for length in 0..file.len() {
            assert!(
                in_gzip(&file[..length], HGT_BYTES_MAX).is_err(),
                "cut to {length}"
            );
        }
    }
}
