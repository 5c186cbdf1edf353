//! What surrounds a flight on hardware: the marker is seen before, and the throttle rests after, whatever happens.

use std::panic::{AssertUnwindSafe, catch_unwind};

use bench_device::{Clock, DeviceError, PositionSource, TrackStatus, VoltageOutput};
use bench_rig::{Mission, Rig};

use crate::{Directive, Ending, Flown, Progress, Sink, Summary, fly};

/// Waits until the tracker has seen the marker; false when it has not within `patience_s` seconds.
pub fn await_marker(
    clock: &mut impl Clock,
    tracker: &mut impl PositionSource,
    patience_s: f64,
) -> Result<bool, DeviceError> {
    let began = clock.now();
    loop {
        while let Some(sample) = tracker.poll()? {
            if sample.status == TrackStatus::Found {
                return Ok(true);
            }
        }
        let now = clock.now();
        if now.since_s(began) > patience_s {
            return Ok(false);
        }
        clock.wait_until(now.shifted(0.02))?;
    }
}

/// [`fly`], where a panic in the controller, an end or the sink is one more way for a flight to end: the throttle goes to rest first.
pub fn fly_guarded<C: Clock, V: VoltageOutput, P: PositionSource, S: Sink, D: Into<Directive>>(
    (clock, output, tracker): (&mut C, &mut V, &mut P),
    rig: &Rig,
    mission: &Mission,
    sink: &mut S,
    each: impl FnMut(&Progress, &mut S) -> D,
) -> Flown {
    let flight = AssertUnwindSafe(|| fly((clock, &mut *output, tracker), rig, mission, sink, each));
    catch_unwind(flight).unwrap_or_else(|panic| {
        // The output may be what panicked; the board's own watchdog is behind it.
        let _ = catch_unwind(AssertUnwindSafe(|| {
            let _ = output.write(rig.airframe.sticks.at_rest());
            let _ = output.read_back();
        }));
        let words = panic
            .downcast_ref::<&str>()
            .map(|words| (*words).to_owned())
            .or_else(|| panic.downcast_ref::<String>().cloned())
            .unwrap_or_else(|| "no words".to_owned());
        Flown { ending: Ending::Panicked(words), summary: Summary::default() }
    })
}
