//! Cells of a log to numbers and times. Whatever is not a number is a [`Fault`], never a guess.

use super::report::SkipReason;

/// The finite number that a cell holds.
pub(super) fn finite(text: &str) -> Result<f64, SkipReason> {
    if text.is_empty() {
        return Err(SkipReason::Empty);
    }
    match text.parse::<f64>() {
        Ok(number) if number.is_finite() => Ok(number),
        Ok(number) if number.is_nan() => Err(SkipReason::Nan),
        Ok(_) => Err(SkipReason::Infinite),
        Err(_) => Err(SkipReason::NotANumber),
    }
}

/// The unit of a time column, as the power of ten that makes nanoseconds of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct TimeUnit(u32);

impl TimeUnit {
    /// The units that a map may name.
    pub const CHOICES: [(&str, Self); 4] =
        [("s", Self(9)), ("ms", Self(6)), ("us", Self(3)), ("ns", Self(0))];
}

/// The time that a cell holds, in ns. Decimal fractions are read exactly to the nanosecond: a float that holds seconds
/// since 1970 would be off by as much as 0.1 us.
pub(super) fn nanos(text: &str, unit: TimeUnit) -> Result<i128, SkipReason> {
    if let Some(nanos) = decimal(text, unit.0) {
        return Ok(nanos);
    }
    // Exponents, and all that is no number.
    let number = finite(text)? * 10_f64.powi(unit.0.cast_signed());
    if number.abs() < 1e30 { Ok(number.round() as i128) } else { Err(SkipReason::OutOfRange) }
}

/// `text` times ten to the `power`, rounded half away from zero; `None` if it is more than sign, digits and a point, or
/// too long for an `i128`.
fn decimal(text: &str, power: u32) -> Option<i128> {
    let (negative, digits) = match text.strip_prefix('-') {
        Some(rest) => (true, rest),
        None => (false, text.strip_prefix('+').unwrap_or(text)),
    };
    let (whole, fraction) = digits.split_once('.').unwrap_or((digits, ""));
    let only_digits = whole.bytes().chain(fraction.bytes()).all(|byte| byte.is_ascii_digit());
    if !only_digits || whole.is_empty() && fraction.is_empty() {
        return None;
    }
    let mut value = if whole.is_empty() { 0 } else { whole.parse::<i128>().ok()? };
    let mut fraction = fraction.bytes().map(|byte| i128::from(byte - b'0'));
    for _ in 0..power {
        value = value.checked_mul(10)?.checked_add(fraction.next().unwrap_or(0))?;
    }
    if fraction.next().is_some_and(|digit| digit >= 5) {
        value = value.checked_add(1)?;
    }
    Some(if negative { -value } else { value })
}

#[cfg(test)]
mod tests {
    use super::{SkipReason, TimeUnit, finite, nanos};

    const S: TimeUnit = TimeUnit(9);
    const NS: TimeUnit = TimeUnit(0);

    #[test]
    fn times_are_exact_to_the_nanosecond_however_long_the_number() {
        assert_eq!(nanos("1772429894.780505180", S), Ok(1_772_429_894_780_505_180));
        assert_eq!(nanos("1772429894780505181", NS), Ok(1_772_429_894_780_505_181));
        assert_eq!(nanos("-.5", S), Ok(-500_000_000));
        assert_eq!(nanos("+3.", S), Ok(3_000_000_000));
        assert_eq!(nanos("0.0000000015", S), Ok(2));
        assert_eq!(nanos("2.5", NS), Ok(3));
        assert_eq!(nanos("1.5e-3", S), Ok(1_500_000));
    }

    #[test]
    fn what_is_no_time_is_said_by_kind() {
        assert_eq!(nanos("", S), Err(SkipReason::Empty));
        assert_eq!(nanos(".", S), Err(SkipReason::NotANumber));
        assert_eq!(nanos("12:03", S), Err(SkipReason::NotANumber));
        assert_eq!(nanos("nan", S), Err(SkipReason::Nan));
        assert_eq!(nanos("-inf", S), Err(SkipReason::Infinite));
        assert_eq!(nanos("1e40", S), Err(SkipReason::OutOfRange));
        assert_eq!(finite("1e999"), Err(SkipReason::Infinite));
        assert_eq!(finite("0,5"), Err(SkipReason::NotANumber));
    }
}
