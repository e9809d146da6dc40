//! Serial ports of this machine, and the names that they keep.

use std::fs;
use std::path::{Path, PathBuf};

/// Where udev gives each USB port a name made of what its adapter says of itself.
const BY_ID: &str = "/dev/serial/by-id";

/// The ports that are there, by path.
#[must_use]
pub fn all() -> Vec<PathBuf> {
    let mut ports: Vec<PathBuf> = serialport::available_ports()
        .unwrap_or_default()
        .into_iter()
        .map(|port| port.port_name.into())
        .collect();
    ports.sort();
    ports
}

/// The name that a port keeps when it is unplugged and plugged in again, in another socket too; none where `port` is such
/// a name itself, or has none.
#[must_use]
pub fn lasting_name(port: &Path) -> Option<PathBuf> {
    lasting_name_in(Path::new(BY_ID), port)
}

fn lasting_name_in(folder: &Path, port: &Path) -> Option<PathBuf> {
    if port.starts_with(folder) {
        return None;
    }
    let device = fs::canonicalize(port).ok()?;
    let mut names: Vec<PathBuf> = fs::read_dir(folder)
        .ok()?
        .flatten()
        .map(|entry| entry.path())
        .filter(|name| fs::canonicalize(name).is_ok_and(|target| target == device))
        .collect();
    names.sort();
    names.into_iter().next()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    #[test]
    fn a_port_is_found_under_its_lasting_name() {
        let dev = std::env::temp_dir().join(format!("glasswing-ports-{}", std::process::id()));
        let by_id = dev.join("by-id");
        fs::create_dir_all(&by_id).unwrap();
        for port in ["ttyUSB0", "ttyUSB1"] {
            fs::write(dev.join(port), "").unwrap();
        }
        symlink("../ttyUSB1", by_id.join("usb-Maker_Adapter_7-if00")).unwrap();
        let named = |port: &str| lasting_name_in(&by_id, &dev.join(port));
        let expected = by_id.join("usb-Maker_Adapter_7-if00");
        let found = [
            named("ttyUSB1"),
            named("ttyUSB0"),
            named("absent"),
            lasting_name_in(&by_id, &expected),
        ];
        fs::remove_dir_all(&dev).unwrap();
        assert_eq!(found, [Some(expected), None, None, None]);
    }
}
