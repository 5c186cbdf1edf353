//! A page: verdict, table of contents, sections, and how to make it again.

use maud::{DOCTYPE, Markup, PreEscaped, Render, html};

use crate::{Tone, palette};

const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");
/// uPlot, the plotting library of pages, as a script that defines the global `uPlot`.
pub const UPLOT_JS: &str = include_str!("../vendor/uplot/uPlot.iife.min.js");
/// The style that uPlot needs.
pub const UPLOT_CSS: &str = include_str!("../vendor/uplot/uPlot.min.css");

/// The style that all pages share, with its colours as CSS variables.
pub fn style() -> String {
    palette::css() + STYLE
}

/// What a page may load: nothing but itself. The browser keeps to it whatever stands in the page.
const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'";

/// What a page comes to, told first and in large letters.
pub struct Verdict {
    /// What it means.
    pub tone: Tone,
    /// In a sentence.
    pub words: String,
    /// What is told below it.
    pub below: Markup,
}

impl Verdict {
    /// Without anything below it.
    pub fn new(tone: Tone, words: impl Into<String>) -> Self {
        Self { tone, words: words.into(), below: html! {} }
    }

    /// With something below it.
    #[must_use]
    pub fn with(self, below: Markup) -> Self {
        Self { below, ..self }
    }
}

/// A part of a page that the table of contents names.
pub struct Section {
    title: String,
    words: String,
    body: Markup,
    parts: Vec<Self>,
    verdict: Option<Verdict>,
}

impl Section {
    /// A section with a title.
    pub fn new(title: impl Into<String>, body: Markup) -> Self {
        Self { title: title.into(), words: String::new(), body, parts: Vec::new(), verdict: None }
    }

    /// How to read it, below the title.
    #[must_use]
    pub fn told(self, words: impl Into<String>) -> Self {
        Self { words: words.into(), ..self }
    }

    /// What it comes to: a verdict of its own, where a page has several.
    #[must_use]
    pub fn verdict(self, verdict: Verdict) -> Self {
        Self { verdict: Some(verdict), ..self }
    }

    /// With parts below it.
    #[must_use]
    pub fn parts(mut self, parts: impl IntoIterator<Item = Self>) -> Self {
        self.parts.extend(parts);
        self
    }
}

/// A self-contained page: one HTML file with its style, its plots and their data inside, which loads nothing.
pub struct Page {
    title: String,
    verdict: Verdict,
    sections: Vec<Section>,
    command: String,
    made: Vec<String>,
}

impl Page {
    /// A page under a title, which is the window's; the verdict stands on top.
    pub fn new(title: impl Into<String>, verdict: Verdict) -> Self {
        Self {
            title: title.into(),
            verdict,
            sections: Vec::new(),
            command: String::new(),
            made: vec![format!("bench {}", env!("CARGO_PKG_VERSION"))],
        }
    }

    /// With sections below the verdict.
    #[must_use]
    pub fn sections(mut self, sections: impl IntoIterator<Item = Section>) -> Self {
        self.sections.extend(sections);
        self
    }

    /// The command that makes the page again, as a shell takes it.
    #[must_use]
    pub fn made_by(self, command: impl Into<String>) -> Self {
        Self { command: command.into(), ..self }
    }

    /// What else is told of how it was made, such as the name of its data's schema.
    #[must_use]
    pub fn foot(mut self, words: impl Into<String>) -> Self {
        self.made.push(words.into());
        self
    }

    /// The page as HTML.
    pub fn html(&self) -> String {
        let mut ids = Ids::default();
        let contents: Vec<Placed<'_>> = self.sections.iter().map(|section| ids.place(section, 2)).collect();
        let body = html! {
            (verdict(&self.verdict, 1))
            @for section in &contents { (section) }
            @if !self.command.is_empty() {
                section #again { h2 { "Make it again" } pre { (self.command) } }
            }
            footer { (self.made.join(" \u{b7} ")) }
        };
        let has_plots = body.0.contains("data-plot");
        let toc = html! {
            nav.toc {
                details open {
                    summary { "Contents" }
                    ol { @for section in &contents { (section.entry()) }
                        @if !self.command.is_empty() { li { a href="#again" { "Make it again" } } } }
                }
            }
        };
        let page = html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    meta http-equiv="Content-Security-Policy" content=(POLICY);
                    // Without one, a browser asks the server for an icon.
                    link rel="icon" href="data:,";
                    title { (self.title) }
                    style { @if has_plots { (PreEscaped(UPLOT_CSS)) } (PreEscaped(style())) }
                }
                body {
                    @if contents.len() > 1 { (toc) }
                    main { (body) }
                    @if has_plots { script { (PreEscaped(UPLOT_JS)) (PreEscaped(SCRIPT)) } }
                }
            }
        };
        page.into_string() + "\n"
    }
}

fn verdict(verdict: &Verdict, level: u8) -> Markup {
    let words = html! {
        span.sign aria-hidden="true" { (verdict.tone.sign()) }
        " "
        span { (verdict.words) }
    };
    html! {
        header.verdict.(verdict.tone.class()) {
            @if level == 1 { h1 { (words) } } @else { p.headline { (words) } }
            (verdict.below)
        }
    }
}

/// Names for the parts of a page that a link can go to, each used once.
#[derive(Default)]
struct Ids(Vec<String>);

impl Ids {
    fn of(&mut self, title: &str) -> String {
        let mut id = String::new();
        for character in title.chars().flat_map(char::to_lowercase) {
            match character {
                'a'..='z' | '0'..='9' => id.push(character),
                _ if !id.is_empty() && !id.ends_with('-') => id.push('-'),
                _ => {}
            }
        }
        let base = id.trim_end_matches('-');
        let base = if base.is_empty() || base == "again" { "part" } else { base };
        let mut id = base.to_owned();
        let mut count = 1;
        while self.0.contains(&id) {
            count += 1;
            id = format!("{base}-{count}");
        }
        self.0.push(id.clone());
        id
    }

    fn place<'a>(&mut self, section: &'a Section, level: u8) -> Placed<'a> {
        let id = self.of(&section.title);
        let parts = section.parts.iter().map(|part| self.place(part, level + 1)).collect();
        Placed { section, id, level, parts }
    }
}

/// A section with its place in the page.
struct Placed<'a> {
    section: &'a Section,
    id: String,
    level: u8,
    parts: Vec<Self>,
}

impl Placed<'_> {
    fn entry(&self) -> Markup {
        html! {
            li {
                a href={ "#" (self.id) } { (self.section.title) }
                // Deeper than this a table of contents is no help.
                @if self.level == 2 && !self.parts.is_empty() {
                    ol { @for part in &self.parts { (part.entry()) } }
                }
            }
        }
    }
}

impl Render for Placed<'_> {
    fn render(&self) -> Markup {
        let Section { title, words, body, verdict: own, .. } = self.section;
        html! {
            section id=(self.id) {
                @match self.level {
                    2 => h2 { (title) },
                    3 => h3 { (title) },
                    _ => h4 { (title) },
                }
                @if let Some(own) = own { (verdict(own, self.level)) }
                @if !words.is_empty() { p.soft.words { (words) } }
                (body)
                @for part in &self.parts { (part) }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_cannot_become_markup_and_nothing_is_loaded() {
        let section = Section::new("<b>", html! { p { "a & b" } });
        let page = Page::new("<a> & \"b\"", Verdict::new(Tone::Good, "<i>"))
            .sections([section])
            .made_by("bench <x>")
            .html();
        assert!(page.contains("<title>&lt;a&gt; &amp; &quot;b&quot;</title>"), "{page}");
        assert!(page.contains("<h2>&lt;b&gt;</h2>") && page.contains("<pre>bench &lt;x&gt;</pre>"), "{page}");
        assert!(page.contains("default-src 'none'") || page.contains("default-src &#39;none&#39;"), "{page}");
        for loads in ["src=", "@import", "url(", "<script"] {
            assert!(!page.contains(loads), "{loads}");
        }
    }

    #[test]
    fn sections_of_one_title_have_links_of_their_own() {
        let named = |title: &str| Section::new(title, html! {});
        let page = Page::new("x", Verdict::new(Tone::Plain, "x"))
            .sections([named("The traces").parts([named("z, m")]), named("The traces"), named("\u{e4}")])
            .html();
        for id in ["the-traces", "the-traces-2", "z-m", "part"] {
            assert_eq!(page.matches(&format!("id=\"{id}\"")).count(), 1, "{id}");
            assert_eq!(page.matches(&format!("href=\"#{id}\"")).count(), 1, "{id}");
        }
    }
}
