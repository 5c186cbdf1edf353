//! Voltages on the wire are whole microvolts in an `i32`: finer than any of the board's converters (its 20-bit ADC
//! steps by 4 uV over 4 V), exact in integer arithmetic, and signed because an input near zero may read below it.

const MICROVOLTS_PER_VOLT: f64 = 1e6;

/// Volts to the nearest microvolt, halves away from zero. `None` for NaN and beyond ±2147.483647 V.
pub fn microvolts(volts: f64) -> Option<i32> {
    let scaled = volts * MICROVOLTS_PER_VOLT;
    // `as` cuts towards zero, so that half a unit outwards first makes it round to nearest (`round` needs `std`).
    let rounded = scaled + 0.5_f64.copysign(scaled);
    // NaN fails this comparison.
    (rounded.abs() < f64::from(i32::MAX) + 1.0).then_some(rounded as i32)
}

/// Microvolts to volts.
pub fn volts(microvolts: i32) -> f64 {
    f64::from(microvolts) / MICROVOLTS_PER_VOLT
}

#[cfg(test)]
mod tests {
    use super::{microvolts, volts};

    #[test]
    fn rounds_to_the_nearest_microvolt_and_refuses_what_does_not_fit() {
        assert_eq!(microvolts(3.3), Some(3_300_000));
        assert_eq!(microvolts(0.000_000_5), Some(1));
        assert_eq!(microvolts(-0.000_000_5), Some(-1));
        assert_eq!(microvolts(0.000_000_499), Some(0));
        assert_eq!(microvolts(2_147.483_647), Some(i32::MAX));
        assert_eq!(microvolts(2_147.483_648), None);
        assert_eq!(microvolts(-2_147.483_648), None);
        assert_eq!(microvolts(f64::NAN), None);
        assert_eq!(microvolts(f64::NEG_INFINITY), None);
    }

    #[test]
    fn a_voltage_survives_the_way_there_and_back() {
        for value in [0, 1, -1, 1_900_000, 3_300_000, i32::MAX, -i32::MAX] {
            assert_eq!(microvolts(volts(value)), Some(value));
        }
    }
}
