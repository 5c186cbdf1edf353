//! The colours of pages and terminals, in one place.
//!
//! They are those of Okabe and Ito, which people with any kind of colour vision tell apart, darkened or lightened until they
//! stand out from the page. A verdict's colour is never its only mark: a sign and a word stand beside it.

use std::fmt::Write as _;

use anstyle::{Ansi256Color, Color, Style};

/// A colour of a page: its name as a CSS variable, on light and on dark ground.
struct Colour {
    name: &'static str,
    light: &'static str,
    dark: &'static str,
}

const fn colour(name: &'static str, light: &'static str, dark: &'static str) -> Colour {
    Colour { name, light, dark }
}

/// How many colours of series there are; the next begins again.
pub const SERIES: usize = 6;

const COLOURS: [Colour; 17] = [
    colour("page", "#fbfbfa", "#14171a"),
    colour("raised", "#ffffff", "#1a1e22"),
    colour("line", "#dcdedb", "#333a41"),
    colour("text", "#191c1f", "#e4e7ea"),
    colour("soft", "#5c646c", "#98a2ab"),
    colour("grid", "#e9ebe8", "#262c32"),
    colour("shade", "#eff1ee", "#20262b"),
    colour("good", "#00704f", "#3ecf9e"),
    colour("bad", "#b03a00", "#ff8a4c"),
    colour("odd", "#7d5f00", "#e8bb3f"),
    colour("accent", "#0064a0", "#62b8ee"),
    colour("s0", "#0072b2", "#56b4e9"),
    colour("s1", "#d55e00", "#ff8c3a"),
    colour("s2", "#00875f", "#2fc493"),
    colour("s3", "#a8568a", "#dc95bf"),
    colour("s4", "#9a7400", "#ecc94b"),
    colour("s5", "#757d84", "#8f99a3"),
];

/// The colours as CSS variables: light, dark where the reader's system is, and light on paper.
pub(crate) fn css() -> String {
    let variables = |of: fn(&Colour) -> &'static str| {
        COLOURS.iter().fold(String::new(), |mut out, colour| {
            // Writing to a String cannot fail.
            let _ = write!(out, "--{}:{};", colour.name, of(colour));
            out
        })
    };
    format!(
        ":root{{color-scheme:light dark;{}}}@media screen and (prefers-color-scheme:dark){{:root:not([data-paper]){{{}}}}}",
        variables(|colour| colour.light),
        variables(|colour| colour.dark)
    )
}

/// What a result means to who reads it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tone {
    /// Passed, the same, closed.
    Good,
    /// Failed, different.
    Bad,
    /// Neither: nothing can be told, or a warning.
    Odd,
    /// Found, without judgement.
    Plain,
}

impl Tone {
    /// Of a check.
    pub const fn of(passed: bool) -> Self {
        if passed { Self::Good } else { Self::Bad }
    }

    /// Name of the class in a page, which sets the variable `--tone`.
    pub(crate) const fn class(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Bad => "bad",
            Self::Odd => "odd",
            Self::Plain => "plain",
        }
    }

    /// The sign beside a word.
    pub const fn sign(self) -> &'static str {
        match self {
            Self::Good => "\u{2713}",
            Self::Bad => "\u{2717}",
            Self::Odd => "?",
            Self::Plain => "\u{2192}",
        }
    }

    /// The style of its words on a terminal: the page's colours, as near as 256 colours come.
    pub const fn style(self) -> Style {
        match self {
            Self::Good => ink(36),
            Self::Bad => ink(166),
            Self::Odd => ink(178),
            Self::Plain => ink(39),
        }
    }
}

const fn ink(colour: u8) -> Style {
    Style::new().fg_color(Some(Color::Ansi256(Ansi256Color(colour)))).bold()
}

/// The style of what is said aside on a terminal.
pub const ASIDE: Style = Style::new().dimmed();
/// The style of headings on a terminal.
pub const HEADING: Style = Style::new().bold();

#[cfg(test)]
mod tests {
    use super::*;

    /// Relative luminance by the rules of WCAG.
    fn luminance(hex: &str) -> f64 {
        let channel = |at: usize| {
            let c = f64::from(u8::from_str_radix(&hex[at..at + 2], 16).unwrap()) / 255.0;
            if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
        };
        0.2126 * channel(1) + 0.7152 * channel(3) + 0.0722 * channel(5)
    }

    fn contrast(a: &str, b: &str) -> f64 {
        let (a, b) = (luminance(a), luminance(b));
        (a.max(b) + 0.05) / (a.min(b) + 0.05)
    }

    #[test]
    fn words_and_lines_stand_out_from_the_page() {
        let page = &COLOURS[0];
        for colour in &COLOURS {
            // As WCAG asks of text, and of what is drawn.
            let least = match colour.name {
                "text" | "soft" | "good" | "bad" | "odd" | "accent" => 4.5,
                name if name.starts_with('s') && name.len() == 2 => 3.0,
                _ => continue,
            };
            for (ink, ground) in [(colour.light, page.light), (colour.dark, page.dark)] {
                let contrast = contrast(ink, ground);
                assert!(contrast >= least, "{} {ink} on {ground}: {contrast:.2}", colour.name);
            }
        }
    }

    #[test]
    fn every_series_has_a_colour_in_light_and_dark() {
        let css = css();
        for series in 0..SERIES {
            assert_eq!(css.matches(&format!("--s{series}:")).count(), 2);
        }
    }
}
