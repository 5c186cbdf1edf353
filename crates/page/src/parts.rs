//! What pages are put together from. Text becomes HTML by the template, so that none can be markup by mistake.

use maud::{Markup, Render, html};

use crate::{Tone, plot::share, ticks};

/// A word with the sign and the colour of what it means.
pub fn badge(tone: Tone, word: &str) -> Markup {
    html! { span.badge.(tone.class()) { (tone.sign()) " " (word) } }
}

/// Passed or not.
pub fn passed(passed: bool) -> Markup {
    badge(Tone::of(passed), if passed { "passed" } else { "failed" })
}

/// Text whose back-quoted parts are code.
pub fn code(text: &str) -> Markup {
    html! {
        @for (i, part) in text.split('`').enumerate() {
            @if i % 2 == 1 { code { (part) } } @else { (part) }
        }
    }
}

/// A figure that is read first: the number, what it is of, and what stands beside it.
pub struct Tile {
    /// The number with its unit.
    pub value: String,
    /// What it is of.
    pub of: String,
    /// An interval, or what it was before.
    pub beside: String,
}

/// Figures side by side.
pub fn tiles(tiles: impl IntoIterator<Item = Tile>) -> Markup {
    html! {
        div.tiles {
            @for tile in tiles {
                div.tile { b { (tile.value) } span { (tile.of) } small { (tile.beside) } }
            }
        }
    }
}

/// A block with a title, words on how to read it, and its content.
pub fn block(title: &str, words: &str, content: impl Render) -> Markup {
    html! {
        div.block {
            @if !title.is_empty() { h4 { (title) } }
            @if !words.is_empty() { p.soft { (words) } }
            (content)
        }
    }
}

/// Blocks beside one another where there is room.
pub fn grid(blocks: impl IntoIterator<Item = Markup>) -> Markup {
    html! { div.grid { @for block in blocks { (block) } } }
}

/// Detail that opens on a click.
pub fn folded(summary: impl Render, beside: &str, open: bool, content: impl Render) -> Markup {
    html! {
        details open[open] {
            summary { span { (summary) } @if !beside.is_empty() { span.soft { (beside) } } }
            div.inside { (content) }
        }
    }
}

/// Names and values in a row.
pub fn facts<'a>(facts: impl IntoIterator<Item = (&'a str, String)>) -> Markup {
    html! {
        dl.facts {
            @for (name, value) in facts {
                @if !value.is_empty() { div { dt { (name) } dd { (value) } } }
            }
        }
    }
}

/// Sentences below one another; their back-quoted parts are code. Nothing where there are none.
pub fn list(lines: &[String]) -> Markup {
    html! { @if !lines.is_empty() { ul { @for line in lines { li { (code(line)) } } } } }
}

/// Sentences that a reader must not miss. Nothing where there are none.
pub fn warnings(lines: &[String]) -> Markup {
    html! {
        @if !lines.is_empty() {
            div.warn { p { (badge(Tone::Odd, "Warnings")) } (list(lines)) }
        }
    }
}

/// How a column of a table stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Column<'a> {
    /// Words, to the left.
    Words(&'a str),
    /// Numbers, to the right, one below the other.
    Number(&'a str),
}

/// A table: names of the columns, then rows of as many cells.
pub fn table(columns: &[Column<'_>], rows: impl IntoIterator<Item = Vec<Markup>>) -> Markup {
    let is_number = |index: usize| matches!(columns.get(index), Some(Column::Number(_)));
    html! {
        div.scroll { table {
            thead { tr {
                @for column in columns {
                    @match column {
                        Column::Words(name) => th { (name) },
                        Column::Number(name) => th.number { (name) },
                    }
                }
            } }
            tbody {
                @for row in rows {
                    tr { @for (index, cell) in row.into_iter().enumerate() {
                        @if is_number(index) { td.number { (cell) } } @else { td { (cell) } }
                    } }
                }
            }
        } }
    }
}

/// A cell of a table.
pub fn cell(content: impl Render) -> Markup {
    content.render()
}

/// What a row of [`Rows`] shows.
#[derive(Clone, Copy, Debug)]
pub struct Bar {
    /// The value.
    pub value: f64,
    /// Its interval, if it has one.
    pub interval: Option<[f64; 2]>,
    /// Drawn as a bar from here to the value; as a dot otherwise.
    pub from: Option<f64>,
    /// Which colour of series.
    pub colour: usize,
}

/// Named values below each other over one axis: marks beside their words, which a table could hold as well.
pub struct Rows {
    rows: Vec<Markup>,
    range: [f64; 2],
}

impl Rows {
    /// Rows over a range.
    pub fn new(range: [f64; 2]) -> Self {
        Self { rows: Vec::new(), range }
    }

    fn percent(&self, x: f64) -> f64 {
        100.0 * share(x, self.range).clamp(0.0, 1.0)
    }

    /// Adds a row: its name, what is drawn, and what is told beside it.
    pub fn row(&mut self, name: impl Render, bar: Option<Bar>, told: &str) {
        let bar = bar.filter(|bar| bar.value.is_finite());
        let place = |from: f64, to: f64| {
            let (a, b) = (self.percent(from), self.percent(to));
            format!("left:{:.2}%;width:{:.2}%", a.min(b), (b - a).abs())
        };
        let marks = html! {
            @for (tick, _) in ticks(self.range, 5.0) { i.tick style={ "left:" (format!("{:.2}", self.percent(tick))) "%" } {} }
            @if let Some(bar) = bar {
                @let colour = format!("c{}", bar.colour);
                @if let Some(from) = bar.from { i.bar.(colour) style=(place(from, bar.value)) {} }
                @if let Some([low, high]) = bar.interval.filter(|ends| ends.iter().all(|end| end.is_finite())) {
                    i.whisker.(colour) style=(place(low, high)) {}
                }
                @if bar.from.is_none() { i.dot.(colour) style={ "left:" (format!("{:.2}", self.percent(bar.value))) "%" } {} }
            }
        };
        let row = html! { span.of { (name) } span.told { (told) } span.track { (marks) } };
        self.rows.push(row);
    }

    /// The rows with their axis.
    pub fn finish(self, title: &str) -> Markup {
        html! {
            div.rows { div {
                @for row in &self.rows { (row) }
                span.foot {
                    span.xaxis {
                        @for (at, text) in ticks(self.range, 5.0) {
                            span style={ "left:" (format!("{:.1}", self.percent(at))) "%" } { (text) }
                        }
                        b { (title) }
                    }
                }
            } }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn back_quotes_become_code_and_markup_stays_text() {
        assert_eq!(code("run `a <b>` & so").into_string(), "run <code>a &lt;b&gt;</code> &amp; so");
    }

    #[test]
    fn what_is_not_finite_is_not_drawn() {
        let mut rows = Rows::new([0.0, 1.0]);
        let bar = Bar { value: f64::NAN, interval: Some([0.0, f64::INFINITY]), from: None, colour: 0 };
        rows.row("none", Some(bar), "-");
        rows.row("half", Some(Bar { value: 0.5, ..bar }), "0.5");
        let html = rows.finish("x").into_string();
        assert!(!html.contains("NaN") && !html.contains("inf"), "{html}");
        assert_eq!(html.matches("dot c0").count(), 1);
    }

    #[test]
    fn a_table_has_numbers_to_the_right_and_every_text_escaped() {
        let columns = [Column::Words("what"), Column::Number("how much")];
        let html = table(&columns, [vec![cell("<b>"), cell(1.5)]]).into_string();
        assert!(html.contains("<td>&lt;b&gt;</td><td class=\"number\">1.5</td>"), "{html}");
    }
}
