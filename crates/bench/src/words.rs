//! How values are said on the screen.

use std::{
    cell::RefCell,
    ffi::OsString,
    fmt,
    io::{self, Write},
    path::Path,
};

use bench_page::{HEADING, Tone};
use clap::builder::Styles;

/// `1234567` as `1,234,567`.
pub fn grouped(count: u64) -> String {
    let digits = count.to_string();
    let mut out = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    out
}

/// Bytes in a unit that suits them.
pub fn size(bytes: u64) -> String {
    match bytes {
        0..=999 => format!("{bytes} B"),
        1_000..=999_999 => format!("{:.1} kB", bytes as f64 / 1e3),
        _ => format!("{:.1} MB", bytes as f64 / 1e6),
    }
}

/// A number of something, in the plural where it needs it.
pub fn count(number: u64, one: &str) -> String {
    format!("{} {one}{}", grouped(number), if number == 1 { "" } else { "s" })
}

/// What an export wrote: the rows of its one table, or how many tables.
pub fn tables(exported: &bench_recording::Exported) -> String {
    match exported.tables.as_slice() {
        [(_, rows)] => count(*rows, "row"),
        tables => count(tables.len() as u64, "table"),
    }
}

/// A word as a shell takes it.
pub fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "-_./=:,+@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', "'\\''"))
    }
}

thread_local! {
    /// The words of a call by another program; empty where the process' own arguments are the command.
    static CALLED: RefCell<Vec<OsString>> = const { RefCell::new(Vec::new()) };
}

/// From here on the command of this thread is the one of a call.
pub fn called_by(words: &[OsString]) {
    CALLED.set(words.to_vec());
}

/// The command that was given, as a shell takes it.
pub fn command() -> String {
    let called = CALLED.with_borrow(Clone::clone);
    let given = if called.is_empty() { std::env::args_os().skip(1).collect() } else { called };
    let given = given.into_iter().map(|word| quoted(&word.to_string_lossy()));
    std::iter::once("bench".to_owned()).chain(given).collect::<Vec<_>>().join(" ")
}

/// The name of a file without its folder.
pub fn file_name(path: impl AsRef<Path>) -> String {
    let path = path.as_ref();
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// Four digits at most, as plain as they can be.
pub fn short(x: f64) -> String {
    if x == 0.0 {
        return "0".to_owned();
    }
    let digits = 3 - x.abs().log10().floor() as i32;
    match digits {
        1..=7 => {
            let text = format!("{x:.*}", digits as usize);
            text.trim_end_matches('0').trim_end_matches('.').to_owned()
        }
        i32::MIN..=0 => format!("{x:.0}"),
        _ => format!("{x:.3e}"),
    }
}

/// A value and its one sigma, as many digits as the sigma tells: two of it.
pub fn with_sigma((value, sigma): (f64, f64)) -> String {
    if !(sigma.is_finite() && sigma > 0.0) {
        return short(value);
    }
    let places = (1 - sigma.log10().floor() as i32).clamp(0, 9) as usize;
    format!("{value:.places$} ± {sigma:.places$}")
}

/// A probability in words: small ones by their size.
pub fn probability(p: f64) -> String {
    if p < 1e-3 { format!("{p:.0e}") } else { format!("{p:.2}") }
}

/// Words in the colour of what they mean. Where no colour is wanted (no terminal, `NO_COLOR`), printing takes it off again.
pub fn toned(tone: Tone, words: &str) -> String {
    let style = tone.style();
    format!("{style}{words}{style:#}")
}

/// Text whose first line is the verdict.
pub fn headed(tone: Tone, text: &str) -> String {
    let (verdict, rest) = text.split_once('\n').unwrap_or((text, ""));
    format!("{}\n{rest}", toned(tone, verdict))
}

/// Whether a check was passed, in a word.
pub fn passed(passed: bool) -> String {
    toned(Tone::of(passed), if passed { "passed" } else { "FAILED" })
}

/// The colours of help and of wrong usage.
pub const fn help_styles() -> Styles {
    Styles::styled()
        .header(HEADING)
        .usage(HEADING)
        .literal(Tone::Plain.style())
        .error(Tone::Bad.style())
        .valid(Tone::Good.style())
        .invalid(Tone::Odd.style())
}

/// Says a line on standard error, like `eprintln!`, which would end a flight where nobody reads it any more.
macro_rules! say {
    ($($words:tt)*) => {
        $crate::words::say_line(format_args!($($words)*))
    };
}
pub(crate) use say;

/// See [`say`].
pub fn say_line(words: fmt::Arguments<'_>) {
    // There is nowhere else to say it.
    let _ = writeln!(anstream::stderr(), "{words}");
}

/// Says what a person should know, also with `--quiet`.
pub fn warn(words: impl fmt::Display) {
    say!("{}: {words}", toned(Tone::Odd, "warning"));
}

/// Says what went wrong, also with `--quiet`.
pub fn fail(words: impl fmt::Display) {
    say!("{}: {words}", toned(Tone::Bad, "error"));
}

/// Writes text to standard output, in colour where that is wanted.
pub fn print(text: &str) -> anyhow::Result<()> {
    write(anstream::stdout().lock(), text)
}

fn write(mut out: impl Write, text: &str) -> anyhow::Result<()> {
    out.write_all(text.as_bytes())?;
    if !text.ends_with('\n') {
        out.write_all(b"\n")?;
    }
    Ok(out.flush()?)
}

/// Prints a serialisable value as JSON.
pub fn print_json(value: &impl serde::Serialize) -> anyhow::Result<()> {
    write(io::stdout().lock(), &serde_json::to_string_pretty(value)?)
}

/// An error with its causes, those left out that the words before tell already.
pub fn causes(error: &anyhow::Error) -> String {
    error.chain().fold(String::new(), |said, cause| match cause.to_string() {
        cause if said.is_empty() => cause,
        cause if said.contains(&cause) => said,
        cause => format!("{said}: {cause}"),
    })
}

/// Whether the reader of our output went away (`bench ... | head`), which is no error.
pub fn is_closed_pipe(error: &anyhow::Error) -> bool {
    error
        .chain()
        .filter_map(|cause| cause.downcast_ref::<io::Error>())
        .any(|cause| cause.kind() == io::ErrorKind::BrokenPipe)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_of_the_command_survive_a_shell() {
        assert_eq!(
            ["a/b-1.mcap", "my flight", "it's", ""].map(quoted),
            ["a/b-1.mcap", "'my flight'", "'it'\\''s'", "''"]
        );
    }

    #[test]
    fn four_digits_are_enough() {
        let told = [0.02, 1.932_4, 350.0, 12_345.6, -0.000_123_45, 0.0].map(short);
        assert_eq!(told, ["0.02", "1.932", "350", "12346", "-0.0001234", "0"]);
    }

    #[test]
    fn values_have_the_digits_that_their_sigma_tells() {
        let told = [(0.105_123, 0.001_26), (1.9, 0.0), (14.83, 12.0), (0.0503, 2e-5)].map(with_sigma);
        assert_eq!(told, ["0.1051 ± 0.0013", "1.9", "15 ± 12", "0.050300 ± 0.000020"]);
    }

    #[test]
    fn numbers_are_grouped_and_sized() {
        assert_eq!([0, 999, 1000, 1_234_567].map(grouped), ["0", "999", "1,000", "1,234,567"]);
        assert_eq!([12, 1500, 2_500_000].map(size), ["12 B", "1.5 kB", "2.5 MB"]);
        assert_eq!(count(1, "message"), "1 message");
        assert_eq!(count(2000, "message"), "2,000 messages");
    }
}
