//! Cells of a log to numbers and times. Whatever is not a number is a [`Fault`], never a guess.

use jiff::{Timestamp, civil::DateTime, tz::TimeZone};

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

/// How a column tells the time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TimeUnit {
    /// As a number, which the power of ten makes nanoseconds of.
    Number(u32),
    /// As date and time in text.
    Iso8601,
}

impl TimeUnit {
    /// The units that a map may name.
    pub const CHOICES: [(&str, Self); 5] = [
        ("s", Self::Number(9)),
        ("ms", Self::Number(6)),
        ("us", Self::Number(3)),
        ("ns", Self::Number(0)),
        ("iso-8601", Self::Iso8601),
    ];
}

/// The time that a cell holds, in ns. Decimal fractions are read exactly to the nanosecond: a float that holds seconds
/// since 1970 would be off by as much as 0.1 us.
pub(super) fn nanos(text: &str, unit: TimeUnit) -> Result<i128, SkipReason> {
    let power = match unit {
        TimeUnit::Number(power) => power,
        TimeUnit::Iso8601 => return date_and_time(text),
    };
    if let Some(nanos) = decimal(text, power) {
        return Ok(nanos);
    }
    // Exponents, and all that is no number.
    let number = finite(text)? * 10_f64.powi(power.cast_signed());
    if number.abs() < 1e30 { Ok(number.round() as i128) } else { Err(SkipReason::OutOfRange) }
}

/// Date and time by ISO 8601 or RFC 3339, in ns since 1970. Without an offset they are taken as UTC: only differences count.
fn date_and_time(text: &str) -> Result<i128, SkipReason> {
    if let Ok(instant) = text.parse::<Timestamp>() {
        return Ok(instant.as_nanosecond());
    }
    let local = text.parse::<DateTime>().map_err(|_| match text {
        "" => SkipReason::Empty,
        "NaN" | "nan" | "NaT" => SkipReason::Nan,
        _ => SkipReason::NotATime,
    })?;
    TimeZone::UTC.to_timestamp(local).map(Timestamp::as_nanosecond).map_err(|_| SkipReason::OutOfRange)
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

    const S: TimeUnit = TimeUnit::Number(9);
    const NS: TimeUnit = TimeUnit::Number(0);

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
    fn dates_and_times_are_those_of_the_calendar() {
        let iso = |text| nanos(text, TimeUnit::Iso8601);
        // `date -u -d 2024-04-15T14:43:21 +%s`
        let same = Ok(1_713_192_201_924_338_000);
        for text in [
            "2024-04-15 14:43:21.924338",
            "2024-04-15T14:43:21.924338Z",
            "2024-04-15T16:43:21.924338+02:00",
            "2024-04-15 09:13:21,924338000-05:30",
            "20240415T144321.924338",
        ] {
            assert_eq!(iso(text), same, "{text}");
        }
        assert_eq!(iso("1970-01-01T00:00:00.000000001"), Ok(1));
        assert_eq!(iso("1969-12-31 23:59:59.5"), Ok(-500_000_000));
        for text in ["12:03:04", "2024-02-30 00:00:00", "15.04.2024 14:43:21", "1713192201.5", "noon"] {
            assert_eq!(iso(text), Err(SkipReason::NotATime), "{text}");
        }
        assert_eq!(iso(""), Err(SkipReason::Empty));
        assert_eq!(iso("NaT"), Err(SkipReason::Nan));
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
