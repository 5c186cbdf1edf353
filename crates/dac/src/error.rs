use std::time::Duration;

use firmware_proto::ErrorCode;
use thiserror::Error;

/// What can go wrong with the board at a port.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum DacError {
    /// No such port.
    #[error("there is no port {port}; {others}; plug the board in, or name its port with --port")]
    NotThere {
        /// The port asked for.
        port: String,
        /// What there is instead, in words.
        others: String,
    },
    /// The port may not be opened by this user.
    #[error(
        "{port} may not be opened by this user; join the group that owns it (often `dialout`) and log in again"
    )]
    Denied {
        /// The port.
        port: String,
    },
    /// Another program has the port.
    #[error("{port} is in use by {holder}; end that program, then try again")]
    Busy {
        /// The port.
        port: String,
        /// Who has it, as far as can be told.
        holder: String,
    },
    /// The port could not be opened for another reason.
    #[error("{port} cannot be opened: {detail}; is it a serial port?")]
    CannotOpen {
        /// The port.
        port: String,
        /// What the system says.
        detail: String,
    },
    /// The port went away while it was in use.
    #[error("{port} went away ({detail}); check the cable, plug the board in again, then start again")]
    Unplugged {
        /// The port.
        port: String,
        /// What the system says.
        detail: String,
    },
    /// Something else than the bench's firmware, or another version of it.
    #[error(
        "{port}: {detail}; flash the firmware of this bench (firmware-proto/firmware) or use the bench of that firmware"
    )]
    WrongFirmware {
        /// The port.
        port: String,
        /// What was heard.
        detail: String,
    },
    /// No answer.
    #[error("{port} gave no answer to {command} for {} ms; is it the board's port, and is the board powered?", waited.as_millis())]
    Timeout {
        /// The port.
        port: String,
        /// What was asked.
        command: &'static str,
        /// For how long.
        waited: Duration,
    },
    /// Bytes came, but none that make an answer.
    #[error(
        "{port} answered {command} with bytes that are no frame ({detail}); is another device on this port, or the cable bad?"
    )]
    Corrupt {
        /// The port.
        port: String,
        /// What was asked.
        command: &'static str,
        /// What is wrong with the bytes.
        detail: String,
    },
    /// The board would not.
    #[error("{port} refused {command}: {}", advice(*code))]
    Refused {
        /// The port.
        port: String,
        /// What was asked.
        command: &'static str,
        /// The board's reason.
        code: ErrorCode,
    },
    /// The board complains, or its outputs do not read what they should.
    #[error("{port}: {detail}")]
    NotSafe {
        /// The port.
        port: String,
        /// What is wrong and what to do.
        detail: String,
    },
    /// A channel's loop from output to input is not what a wire makes.
    #[error("{port}: {channel} {detail}; check the wire from its output to its input")]
    BadLoop {
        /// The port.
        port: String,
        /// Which of throttle, pitch, roll, yaw.
        channel: &'static str,
        /// What was measured.
        detail: String,
    },
    /// The rig's sticks are not voltages.
    #[error(
        "the board puts out volts, but the sticks of {airframe} are not in volts; use an airframe with actuation = \"volt\""
    )]
    NotVolts {
        /// The airframe's name.
        airframe: String,
    },
    /// The operating system would not start a thread or make a pseudo terminal.
    #[error("cannot {action}: {detail}")]
    System {
        /// What was tried.
        action: &'static str,
        /// What the system says.
        detail: String,
    },
}

fn advice(code: ErrorCode) -> &'static str {
    match code {
        ErrorCode::NotArmed => "it is not armed; it may have been reset: check its power",
        ErrorCode::Late => "the command came too late; the link or this machine is too slow for the loop",
        ErrorCode::Tripped => "it tripped, because the host fell silent or its supply sagged; start again",
        ErrorCode::NotReady => {
            "an output does not read zero or a fault stands; check the wires and the supply"
        }
        ErrorCode::Armed => "it is armed; unplug it and plug it in again",
        _ => "the command was damaged on the way; check the cable",
    }
}
