//! Results as pages that need nothing else: one HTML file with its style and its plots inside, light or dark as the
//! reader's system is, wide or narrow as the window is.
//!
//! What a page says belongs to the crate whose result it shows; here is only what such pages share.

mod figure;
mod plot;

pub use figure::{COLOURS, Figure, Mark};
pub use plot::{Bar, Frame, HEIGHT, Point, Rows, Tick, WIDTH, range, share, ticks, x_axis};

/// The style that all pages share.
pub const STYLE: &str = include_str!("page.css");
/// uPlot, the plotting library of pages, as a script that defines the global `uPlot`.
pub const UPLOT_JS: &str = include_str!("../vendor/uplot/uPlot.iife.min.js");
/// The style that uPlot needs.
pub const UPLOT_CSS: &str = include_str!("../vendor/uplot/uPlot.min.css");

/// A whole document. `style` adds to the style that all pages share; `body` is HTML.
pub fn document(title: &str, style: &str, body: &str) -> String {
    format!(
        "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
         <title>{}</title><style>{STYLE}{style}</style></head><body><main>{body}</main></body></html>\n",
        escaped(title)
    )
}

/// Text as HTML, also within quoted attributes.
pub fn escaped(text: &str) -> String {
    text.chars().fold(String::with_capacity(text.len()), |mut out, character| {
        match character {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            other => out.push(other),
        }
        out
    })
}

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_cannot_become_markup() {
        let page = document("<a> & \"b\"", "", "");
        assert!(page.contains("<title>&lt;a&gt; &amp; &quot;b&quot;</title>"), "{page}");
    }

    #[test]
    fn numbers_have_three_digits() {
        let told = [0.0, 1.0, -0.123_456, 12_345.6, 1e-7, f64::NAN, f64::INFINITY].map(digits);
        assert_eq!(told, ["0", "1", "-0.123", "12346", "1.00e-7", "-", "-"]);
    }
}
