//! Why a source cannot be listened to, in words that say what to do.

use std::io;
use std::net::SocketAddr;

/// Why a source cannot be listened to. Displayed as `WHAT: WHY (WHAT TO DO)`.
#[derive(Debug, thiserror::Error)]
#[error("{}: {} ({})", self.what(), self.why(), self.todo())]
pub enum BusError {
    /// Another program listens on the UDP port.
    PortInUse {
        /// The address.
        bind: SocketAddr,
        /// What the system said.
        source: io::Error,
    },
    /// The address is not one of this machine.
    AddressNotLocal {
        /// The address.
        bind: SocketAddr,
        /// What the system said.
        source: io::Error,
    },
    /// There is no such CAN interface.
    InterfaceMissing {
        /// Its name.
        interface: String,
        /// What the system said.
        source: io::Error,
    },
    /// The network interface of that name is no CAN interface.
    NotCan {
        /// Its name.
        interface: String,
        /// What the system said.
        source: io::Error,
    },
    /// The kernel has no CAN.
    NoCan {
        /// The name of the interface.
        interface: String,
        /// What the system said.
        source: io::Error,
    },
    /// The CAN interface is switched off. A bus that was opened all the same is heard as soon as it is switched on.
    InterfaceDown {
        /// Its name.
        interface: String,
    },
    /// There is no such serial port.
    SerialMissing {
        /// Its path.
        path: String,
        /// What the system said.
        source: io::Error,
    },
    /// The path names something else than a serial port.
    NotSerial {
        /// The path.
        path: String,
        /// What the system said.
        source: io::Error,
    },
    /// Another program has the serial port.
    SerialHeld {
        /// Its path.
        path: String,
        /// The other program, as in `gpsd (process 312)`, where this one may know.
        holder: Option<String>,
        /// What the system said.
        source: io::Error,
    },
    /// The serial port does not have the speed.
    SpeedRefused {
        /// Its path.
        path: String,
        /// The speed asked for, bits per second.
        baud: u32,
        /// The speed that it took instead, where it took one.
        instead: Option<u32>,
        /// What the system said.
        source: io::Error,
    },
    /// The program may not use the device.
    NotPermitted {
        /// The device.
        device: String,
        /// What the user can do.
        todo: String,
        /// What the system said.
        source: io::Error,
    },
    /// Anything else that the system refused.
    Refused {
        /// The device.
        device: String,
        /// What the system said.
        source: io::Error,
    },
}

impl BusError {
    /// Whether it will be so for ever: the device is of another kind than the one asked for, or does not have the speed.
    /// Everything else may be over in a moment.
    #[must_use]
    pub const fn is_lasting(&self) -> bool {
        matches!(
            self,
            Self::NotCan { .. } | Self::NotSerial { .. } | Self::SpeedRefused { .. }
        )
    }

    /// The device.
    #[must_use]
    pub fn what(&self) -> String {
        match self {
            Self::PortInUse { bind, .. } | Self::AddressNotLocal { bind, .. } => {
                format!("udp {bind}")
            }
            Self::InterfaceMissing { interface, .. }
            | Self::NotCan { interface, .. }
            | Self::NoCan { interface, .. }
            | Self::InterfaceDown { interface } => format!("can {interface}"),
            Self::SerialMissing { path, .. }
            | Self::NotSerial { path, .. }
            | Self::SerialHeld { path, .. }
            | Self::SpeedRefused { path, .. } => format!("serial {path}"),
            Self::NotPermitted { device, .. } | Self::Refused { device, .. } => device.clone(),
        }
    }

    /// What is wrong with it.
    #[must_use]
    pub fn why(&self) -> String {
        match self {
            Self::PortInUse { bind, .. } => {
                format!("another program listens on port {}", bind.port())
            }
            Self::AddressNotLocal { bind, .. } => {
                format!("{} is no address of this machine", bind.ip())
            }
            Self::InterfaceMissing { .. } => "there is no such interface".to_owned(),
            Self::NotCan { .. } => "is no CAN interface".to_owned(),
            Self::NoCan { .. } => "this system has no CAN".to_owned(),
            Self::InterfaceDown { .. } => "the interface is switched off".to_owned(),
            Self::SerialMissing { .. } => "there is no such port".to_owned(),
            Self::NotSerial { .. } => "is no serial port".to_owned(),
            Self::SerialHeld { holder: None, .. } => "another program has it".to_owned(),
            Self::SerialHeld {
                holder: Some(holder),
                ..
            } => format!("another program has it: {holder}"),
            Self::SpeedRefused {
                baud,
                instead: None,
                ..
            } => format!("it does not do {baud} baud"),
            Self::SpeedRefused {
                baud,
                instead: Some(instead),
                ..
            } => format!("it does not do {baud} baud, it would do {instead}"),
            Self::NotPermitted { .. } => "this program may not use it".to_owned(),
            Self::Refused { .. } => "the system refused it".to_owned(),
        }
    }

    /// What the system said, if it was asked.
    #[must_use]
    pub fn into_source(self) -> Option<io::Error> {
        match self {
            Self::InterfaceDown { .. } => None,
            Self::PortInUse { source, .. }
            | Self::AddressNotLocal { source, .. }
            | Self::InterfaceMissing { source, .. }
            | Self::NotCan { source, .. }
            | Self::NoCan { source, .. }
            | Self::SerialMissing { source, .. }
            | Self::NotSerial { source, .. }
            | Self::SerialHeld { source, .. }
            | Self::SpeedRefused { source, .. }
            | Self::NotPermitted { source, .. }
            | Self::Refused { source, .. } => Some(source),
        }
    }

    /// What the user can do.
    #[must_use]
    pub fn todo(&self) -> String {
        match self {
            Self::PortInUse { bind, .. } => format!(
                "stop it, `ss -ulnp sport = :{}` names it, or choose another port",
                bind.port()
            ),
            Self::AddressNotLocal { .. } => {
                "choose one that `ip address` lists, or 0.0.0.0 for all".to_owned()
            }
            Self::InterfaceMissing { interface, .. } if interface.starts_with("vcan") => {
                format!("make it: ip link add {interface} type vcan && ip link set {interface} up")
            }
            Self::InterfaceMissing { interface, .. } => format!(
                "connect the adapter, `glasswing list` names what is there, then: {}",
                switch_on(interface)
            ),
            Self::NotCan { .. } => "`glasswing list` names those that are".to_owned(),
            Self::NoCan { .. } => "load the kernel's: modprobe can_raw".to_owned(),
            Self::InterfaceDown { interface } => switch_on(interface),
            Self::SerialMissing { .. } => {
                "connect it; `glasswing list` names what is there".to_owned()
            }
            Self::NotSerial { .. } => "`glasswing list` names those that are".to_owned(),
            Self::SerialHeld { path, .. } => {
                format!("stop it; `fuser -v {path}` names those that have it")
            }
            Self::SpeedRefused { .. } => {
                "give the sender a speed that both have, 9600 and 115200 are usual".to_owned()
            }
            Self::NotPermitted { todo, .. } => todo.clone(),
            Self::Refused { .. } => "see the system's log".to_owned(),
        }
    }
}

/// How an interface is switched on. A controller that has left the bus comes back by itself only when told so beforehand.
fn switch_on(interface: &str) -> String {
    if interface.starts_with("vcan") {
        format!("ip link set {interface} up")
    } else {
        format!("ip link set {interface} up type can bitrate 500000 restart-ms 100")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_name_the_device_and_the_remedy() {
        let e = BusError::InterfaceMissing {
            interface: "vcan0".into(),
            source: io::ErrorKind::NotFound.into(),
        };
        assert_eq!(
            e.to_string(),
            "can vcan0: there is no such interface (make it: ip link add vcan0 type vcan && ip link set vcan0 up)"
        );
        let e = BusError::PortInUse {
            bind: ([127, 0, 0, 1], 5500).into(),
            source: io::ErrorKind::AddrInUse.into(),
        };
        assert!(
            e.to_string()
                .starts_with("udp 127.0.0.1:5500: another program listens on port 5500 ("),
            "{e}"
        );
        let e = BusError::SerialHeld {
            path: "/dev/ttyUSB0".into(),
            holder: Some("gpsd (process 312)".into()),
            source: io::ErrorKind::ResourceBusy.into(),
        };
        assert_eq!(
            e.to_string(),
            "serial /dev/ttyUSB0: another program has it: gpsd (process 312) (stop it; `fuser -v /dev/ttyUSB0` names those that have it)"
        );
    }
}
