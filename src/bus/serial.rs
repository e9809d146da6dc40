//! Serial ports: pieces of a byte stream, as they come.
//!
//! A port is opened for this program alone (`TIOCEXCL` and a lock, as other careful programs do), 8 data bits, no parity, one
//! stop bit, no flow control, at any speed that the driver takes. A name under `/dev/serial/by-id` stays with its adapter
//! wherever that is plugged in. A port that is unplugged fails the next read, and is opened again when it is back.

use super::{BusError, Source, WAIT};
use crate::signal::Wire;
use crate::time::Monotonic;
use serialport::{ErrorKind, SerialPort as _, TTYPort};
use std::fs::OpenOptions;
use std::io::{self, IsTerminal as _, Read as _};
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _};

/// The most that is taken at once: 45 ms at 115 200 bit/s.
const PIECE_BYTES: usize = 512;

/// A speed read back may differ by as much as a receiver tolerates: half a bit over ten.
const SPEED_TOLERANCE: f64 = 0.03;

/// An open port.
pub(super) struct Port {
    device: String,
    baud: u32,
    port: TTYPort,
    buffer: [u8; PIECE_BYTES],
}

impl Port {
    pub(super) fn open(device: String, baud: u32) -> Result<Self, BusError> {
        let port = open(&device, baud).map_err(|e| refusal(&device, baud, e))?;
        Ok(Self {
            device,
            baud,
            port,
            buffer: [0; PIECE_BYTES],
        })
    }
}

fn open(device: &str, baud: u32) -> Result<TTYPort, serialport::Error> {
    let port = serialport::new(device, baud).timeout(WAIT).open_native()?;
    let real = port.baud_rate()?;
    if (f64::from(real) / f64::from(baud) - 1.0).abs() > SPEED_TOLERANCE {
        let what = format!("the driver offers {real} instead");
        return Err(serialport::Error::new(ErrorKind::InvalidInput, what));
    }
    Ok(port)
}

/// What is wrong with the port: the library tells most things alike, so the device is asked once more.
fn refusal(device: &str, baud: u32, error: serialport::Error) -> BusError {
    let device = device.to_owned();
    let flags = rustix::fs::OFlags::NONBLOCK | rustix::fs::OFlags::NOCTTY;
    let asked = OpenOptions::new()
        .read(true)
        .write(true)
        .custom_flags(i32::try_from(flags.bits()).unwrap_or(0))
        .open(&device);
    let kind = error.kind();
    let source = io::Error::from(error);
    match asked {
        Err(e) if e.kind() == io::ErrorKind::PermissionDenied => BusError::SerialNotPermitted {
            group: group_of(&device),
            device,
            source: e,
        },
        Err(e) if e.kind() == io::ErrorKind::ResourceBusy => {
            BusError::SerialHeld { device, source: e }
        }
        Err(e) => BusError::SerialMissing { device, source: e },
        Ok(file) if !file.is_terminal() => BusError::SerialNone { device, source },
        Ok(_) if kind == ErrorKind::InvalidInput => BusError::SerialSpeed {
            device,
            baud,
            source,
        },
        Ok(_) => BusError::SerialHeld { device, source },
    }
}

/// The name of the group that a device belongs to, or its number.
fn group_of(device: &str) -> String {
    let Ok(metadata) = std::fs::metadata(device) else {
        return "dialout".to_owned();
    };
    let gid = metadata.gid().to_string();
    let groups = std::fs::read_to_string("/etc/group").unwrap_or_default();
    let name = groups.lines().find_map(|line| {
        let mut words = line.split(':');
        let name = words.next()?;
        (words.nth(1)? == gid).then(|| name.to_owned())
    });
    name.unwrap_or(gid)
}

impl Source for Port {
    fn receive(&mut self) -> io::Result<Option<(Monotonic, Wire<'_>)>> {
        match self.port.read(&mut self.buffer) {
            Ok(0) => Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(n) => Ok(Some((Monotonic::read(), Wire::Stream(&self.buffer[..n])))),
            Err(e) if super::udp::is_pause(&e) => Ok(None),
            Err(e) => Err(e),
        }
    }

    fn reopen(&mut self) -> io::Result<()> {
        self.port = open(&self.device, self.baud).map_err(io::Error::from)?;
        Ok(())
    }
}
