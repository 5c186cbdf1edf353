//! Scripted devices for tests of whoever drives the traits.

use std::collections::VecDeque;

use crate::{
    Clock, DeviceError, Faults, PositionSample, PositionSource, Readback, Sticks, Time, VoltageOutput,
};

/// A clock that jumps to each deadline, plus the lateness scripted for it.
#[derive(Debug, Default)]
pub struct FakeClock {
    now: Time,
    lateness_s: VecDeque<f64>,
}

impl FakeClock {
    /// Adds the lateness of the next unscripted wait, seconds.
    pub fn push_lateness_s(&mut self, lateness_s: f64) {
        self.lateness_s.push_back(lateness_s);
    }
}

impl Clock for FakeClock {
    fn now(&self) -> Time {
        self.now
    }

    fn wait_until(&mut self, deadline: Time) -> Result<Time, DeviceError> {
        let late = self.lateness_s.pop_front().unwrap_or(0.0).max(0.0);
        self.now = self.now.max(deadline).shifted(late);
        Ok(self.now)
    }
}

/// Returns the scripted samples one by one, then nothing; or the scripted error.
#[derive(Debug, Default)]
pub struct FakePositionSource {
    script: VecDeque<Result<Option<PositionSample>, DeviceError>>,
}

impl FakePositionSource {
    /// Adds what the next unscripted poll returns.
    pub fn push(&mut self, answer: Result<Option<PositionSample>, DeviceError>) {
        self.script.push_back(answer);
    }
}

impl PositionSource for FakePositionSource {
    fn poll(&mut self) -> Result<Option<PositionSample>, DeviceError> {
        self.script.pop_front().unwrap_or(Ok(None))
    }
}

/// Keeps every write and reads back the last one exactly; fails from the write numbered `fail_after` on.
#[derive(Debug, Default)]
pub struct FakeVoltageOutput {
    /// All that was written, in order.
    pub written: Vec<Sticks>,
    /// How many writes succeed before the device is gone; `None`: all.
    pub fail_after: Option<usize>,
}

impl VoltageOutput for FakeVoltageOutput {
    fn write(&mut self, sticks: Sticks) -> Result<(), DeviceError> {
        if self.fail_after.is_some_and(|n| self.written.len() >= n) {
            return Err(DeviceError::Gone { device: "fake output", detail: "scripted".into() });
        }
        self.written.push(sticks);
        Ok(())
    }

    fn read_back(&mut self) -> Result<Option<Readback>, DeviceError> {
        Ok(Some(Readback {
            device_time: Time::from_nanos(self.written.len() as u64),
            sticks: self.written.last().copied().unwrap_or_default(),
            faults: Faults::default(),
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_clock_never_runs_back_and_adds_scripted_lateness() {
        let mut clock = FakeClock::default();
        clock.push_lateness_s(0.02);
        assert_eq!(clock.wait_until(Time::from_seconds(0.1)), Ok(Time::from_seconds(0.12)));
        assert_eq!(clock.wait_until(Time::from_seconds(0.1)), Ok(Time::from_seconds(0.12)));
    }

    #[test]
    fn the_output_reads_back_its_last_write_until_it_is_gone() {
        let mut output = FakeVoltageOutput { fail_after: Some(1), ..Default::default() };
        let sticks = Sticks { throttle: 1.9, ..Default::default() };
        output.write(sticks).unwrap();
        assert_eq!(output.read_back().unwrap().unwrap().sticks, sticks);
        assert!(matches!(output.write(sticks), Err(DeviceError::Gone { .. })));
    }
}
