//! Time by the wall clock, and what the operating system grants a thread that must keep it.

use std::fmt;

use bench_device::{Clock, DeviceError, Time};
use rustix::{
    mm::{MlockAllFlags, mlockall},
    thread::{clock_nanosleep_absolute, set_current_timer_slack},
    time::{ClockId, Timespec, clock_gettime},
};
use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadSchedulePolicy, set_thread_priority_and_policy,
    thread_native_id,
};

/// Below the kernel's own threads for interrupts and timers (99), above everything else.
const FIFO_PRIORITY: u8 = 80;

/// The monotonic clock, from an origin of its own. Copies share the origin.
#[derive(Clone, Copy, Debug)]
pub struct WallClock {
    origin_ns: u64,
}

impl WallClock {
    /// A clock that reads zero now.
    pub fn start() -> Self {
        Self { origin_ns: monotonic_ns() }
    }
}

impl Clock for WallClock {
    fn now(&self) -> Time {
        Time::from_nanos(monotonic_ns().saturating_sub(self.origin_ns))
    }

    /// Sleeps until an absolute deadline, so that lateness does not add up.
    fn wait_until(&mut self, deadline: Time) -> Result<Time, DeviceError> {
        let ns = self.origin_ns.saturating_add(deadline.nanos());
        let (seconds, nanos) = (ns / 1_000_000_000, ns % 1_000_000_000);
        let until = Timespec { tv_sec: seconds.cast_signed(), tv_nsec: nanos.cast_signed() };
        loop {
            match clock_nanosleep_absolute(ClockId::Monotonic, &until) {
                Ok(()) => return Ok(self.now()),
                Err(rustix::io::Errno::INTR) => {}
                Err(error) => {
                    let detail = format!("cannot sleep: {error}");
                    return Err(DeviceError::Failed { device: "the clock", detail });
                }
            }
        }
    }
}

fn monotonic_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec as u64 * 1_000_000_000 + now.tv_nsec as u64
}

/// What a thread was granted.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Granted {
    /// Why the thread has no real-time priority; `None` when it has.
    pub no_priority: Option<String>,
    /// Why memory may be paged out; `None` when it is locked.
    pub no_lock: Option<String>,
}

impl Granted {
    /// Asks for the calling thread to be run before all others (`SCHED_FIFO`), and for the process's memory to stay where it is.
    /// Threads that it starts from then on inherit the priority. What is refused costs lateness, not function.
    pub fn ask() -> Self {
        // The kernel may otherwise put off an ordinary thread's timer by 50 us, to save wake-ups.
        let _ = set_current_timer_slack(std::num::NonZeroU64::new(1));
        let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
        let priority =
            ThreadPriority::try_from(FIFO_PRIORITY).map_err(ToString::to_string).and_then(|priority| {
                set_thread_priority_and_policy(thread_native_id(), priority, policy).map_err(|error| {
                    match error {
                        thread_priority::Error::OS(code) => {
                            std::io::Error::from_raw_os_error(code).to_string()
                        }
                        other => format!("{other:?}"),
                    }
                })
            });
        let lock = mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE);
        Self { no_priority: priority.err(), no_lock: lock.err().map(|error| error.to_string()) }
    }
}

impl fmt::Display for Granted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.no_priority {
            None => write!(f, "real-time priority {FIFO_PRIORITY} (SCHED_FIFO)")?,
            Some(reason) => write!(
                f,
                "ordinary priority, expect late ticks on a busy machine (SCHED_FIFO: {reason}; run as root or raise `ulimit -r`)"
            )?,
        }
        match &self.no_lock {
            None => write!(f, ", memory locked"),
            Some(reason) => write!(f, ", memory not locked ({reason}; raise `ulimit -l`)"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waiting_ends_at_or_after_the_deadline_and_not_at_all_for_one_that_is_past() {
        let mut clock = WallClock::start();
        for ms in [1.0, 2.0, 2.0, 0.5] {
            let deadline = Time::from_seconds(ms / 1000.0);
            assert!(clock.wait_until(deadline).unwrap() >= deadline);
        }
        let copy = clock;
        assert!(copy.now() >= Time::from_seconds(0.002));
    }
}
