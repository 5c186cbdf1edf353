//! Results as pages that need nothing else: one HTML file with its style, its plots and their data inside, light or dark as the
//! reader's system is, wide or narrow as the window is.
//!
//! What a page says belongs to the crate whose result it shows; here is only what such pages share: the [`Page`] with its
//! verdict and [`Section`]s, the [`parts`] that sections are put together from, [`Plot`]s, and the colours of pages and
//! terminals alike. All text becomes HTML by the templates of `maud`, which escape it.

mod document;
mod palette;
pub mod parts;
mod plot;
mod svg;

pub use document::{Page, Section, UPLOT_CSS, UPLOT_JS, Verdict, style};
pub use palette::{ASIDE, HEADING, SERIES, Tone};
pub use plot::{Mark, Panel, Plot, STRETCHES, Series, Span, Tick, range, range_without_spikes, share, ticks};

/// A number with three significant digits, as short as it can be; `-` for what is no number.
pub fn digits(x: f64) -> String {
    let size = x.abs();
    if !x.is_finite() {
        "-".to_owned()
    } else if x == 0.0 {
        "0".to_owned()
    } else if (1e-4..1e5).contains(&size) {
        let places = (2 - size.log10().floor() as i32).clamp(0, 6) as usize;
        let text = format!("{x:.places$}");
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
    } else {
        format!("{x:.2e}")
    }
}

/// Words that begin a sentence.
pub fn capitalised(words: &str) -> String {
    let mut characters = words.chars();
    characters.next().map_or_else(String::new, |first| first.to_uppercase().chain(characters).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_three_digits() {
        let told = [0.0, 1.0, -0.123_456, 12_345.6, 1e-7, f64::NAN, f64::INFINITY].map(digits);
        assert_eq!(told, ["0", "1", "-0.123", "12346", "1.00e-7", "-", "-"]);
    }
}
