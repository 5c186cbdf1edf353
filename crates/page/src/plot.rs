//! Plots as data. A page draws them with uPlot and a script of its own: they zoom, pan and read off. [`Plot::svg`] draws the
//! same data as a figure that stands alone.

use std::collections::HashMap;

use maud::{Markup, PreEscaped, Render, html};
use serde::Serialize;

use crate::digits;

/// A number on an axis: where, and what stands there.
pub type Tick = (f64, String);

/// A long series is drawn by so many stretches of equal length, the least and the greatest value of each.
pub const STRETCHES: usize = 5000;

/// How far along a range, 0 to 1 within it.
pub fn share(x: f64, [from, to]: [f64; 2]) -> f64 {
    if to > from { (x - from) / (to - from) } else { 0.5 }
}

/// Least and greatest of the finite values, with some room; 0 to 1 if there are none.
pub fn range(values: impl IntoIterator<Item = f64>) -> [f64; 2] {
    let [low, high] = values
        .into_iter()
        .filter(|value| value.is_finite())
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| [low.min(value), high.max(value)]);
    if low > high {
        return [0.0, 1.0];
    }
    let room = match high - low {
        0.0 if high == 0.0 => 1.0,
        0.0 => 0.1 * high.abs(),
        length => 0.06 * length,
    };
    [low - room, high + room]
}

/// Round numbers within a range, about `wanted` of them.
pub fn ticks([from, to]: [f64; 2], wanted: f64) -> Vec<Tick> {
    let rough = (to - from) / wanted;
    if rough <= 0.0 || !rough.is_finite() {
        return Vec::new();
    }
    let magnitude = 10_f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|factor| factor * magnitude).find(|step| *step >= rough);
    let Some(step) = step.filter(|step| *step > 0.0) else { return Vec::new() };
    let (first, last) = ((from / step).ceil() as i64, (to / step).floor() as i64);
    // A range far from zero and narrow has more ticks than a real number tells apart.
    if last.saturating_sub(first) > 20 {
        return Vec::new();
    }
    (first..=last).map(|i| (i as f64 * step, digits(i as f64 * step))).collect()
}

/// This share of the values may lie outside of what is shown at either end, where they are spikes.
const SPIKES_SHARE: f64 = 0.015;
/// What is more than so many times as far apart as the rest is a spike.
const SPIKE_TIMES: f64 = 3.0;

/// The range of values and of what must be seen. A spike, such as that of touching down, does not rule it.
pub fn range_without_spikes(values: impl IntoIterator<Item = f64>, seen: &[f64]) -> [f64; 2] {
    let mut values: Vec<f64> = values.into_iter().filter(|value| value.is_finite()).collect();
    values.sort_by(f64::total_cmp);
    let spikes = (values.len() as f64 * SPIKES_SHARE).ceil() as usize;
    let seen = || seen.iter().copied();
    if let (Some(&[low, ..]), Some(&[.., high])) =
        (values.get(spikes..), values.len().checked_sub(spikes).map(|end| &values[..end]))
        && let (Some(least), Some(most)) = (values.first(), values.last())
        && high > low
        && most - least > SPIKE_TIMES * (high - low)
    {
        return range([low, high].into_iter().chain(seen()));
    }
    range(values.into_iter().chain(seen()))
}

/// How a series is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Mark {
    /// A line through the points.
    Line,
    /// The same, dashed.
    Dashed,
    /// A line that holds each value until the next.
    Steps,
    /// A dot each.
    Dots,
    /// A cross each.
    Crosses,
    /// The area between least and greatest value.
    Band,
    /// A wide band behind all others, faint.
    Zone,
}

/// Points of one name, mark and colour. A value that is not finite is a gap.
#[derive(Clone, Debug)]
pub struct Series {
    pub(crate) name: String,
    pub(crate) mark: Mark,
    pub(crate) colour: usize,
    pub(crate) x: Vec<f64>,
    /// The values; of a band, its upper ends.
    pub(crate) high: Vec<f64>,
    /// The lower ends of a band, else empty.
    pub(crate) low: Vec<f64>,
}

impl Series {
    /// Points in the order of x, thinned where there are more than can be seen. Colours are counted from zero and begin again;
    /// an empty name is not in the legend.
    pub fn new(
        name: impl Into<String>,
        mark: Mark,
        colour: usize,
        points: impl IntoIterator<Item = (f64, f64)>,
    ) -> Self {
        let points: Vec<(f64, f64)> = points.into_iter().filter(|(x, _)| x.is_finite()).collect();
        let (x, high) = thinned(&points, STRETCHES).into_iter().unzip();
        Self { name: name.into(), mark, colour, x, high, low: Vec::new() }
    }

    /// A band: where, and its lower and upper end there.
    pub fn band(
        name: impl Into<String>,
        mark: Mark,
        colour: usize,
        points: impl IntoIterator<Item = [f64; 3]>,
    ) -> Self {
        let points: Vec<[f64; 3]> = points.into_iter().filter(|[x, ..]| x.is_finite()).collect();
        let x = points.iter().map(|[x, ..]| *x).collect();
        let low = points.iter().map(|[_, low, _]| *low).collect();
        let high = points.iter().map(|[.., high]| *high).collect();
        Self { name: name.into(), mark, colour, x, high, low }
    }

    pub(crate) fn values(&self) -> impl Iterator<Item = f64> {
        self.high.iter().chain(&self.low).copied()
    }
}

/// Of points in the order of x, the least and the greatest of each of so many equal stretches, in the order in which they come:
/// true samples, so that peaks stay. Gaps stay, too.
fn thinned(points: &[(f64, f64)], stretches: usize) -> Vec<(f64, f64)> {
    let (Some((first, _)), Some((last, _))) = (points.first(), points.last()) else { return Vec::new() };
    if points.len() <= 2 * stretches || last <= first {
        return points.to_vec();
    }
    let place = |x: f64| ((share(x, [*first, *last]) * stretches as f64) as usize).min(stretches - 1);
    let mut out = Vec::with_capacity(2 * stretches);
    for stretch in points.chunk_by(|a, b| place(a.0) == place(b.0)) {
        for run in stretch.chunk_by(|a, b| a.1.is_finite() == b.1.is_finite()) {
            let by_value = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
            let (Some(least), Some(most)) = (run.iter().min_by(by_value), run.iter().max_by(by_value)) else {
                continue;
            };
            let (before, after) = if least.0 <= most.0 { (least, most) } else { (most, least) };
            out.push(*before);
            if before.0 < after.0 {
                out.push(*after);
            }
        }
    }
    out
}

/// One pair of axes. Panels of a plot stand below one another over one x axis.
#[derive(Clone, Debug)]
pub struct Panel {
    pub(crate) y_title: String,
    pub(crate) series: Vec<Series>,
    pub(crate) y: Option<[f64; 2]>,
    fixed: bool,
    pub(crate) low: bool,
    bands: Vec<[f64; 2]>,
    pub(crate) levels: Vec<(f64, String)>,
}

impl Panel {
    /// What its y axis shows, with the unit: `altitude, m`.
    pub fn new(y_title: impl Into<String>) -> Self {
        Self {
            y_title: y_title.into(),
            series: Vec::new(),
            y: None,
            fixed: false,
            low: false,
            bands: Vec::new(),
            levels: Vec::new(),
        }
    }

    /// With a series.
    #[must_use]
    pub fn with(mut self, series: Series) -> Self {
        if !series.x.is_empty() {
            self.series.push(series);
        }
        self
    }

    /// Ends of the y axis as the page opens, where they are not to follow what is seen. Zoomed in, they follow it.
    #[must_use]
    pub fn y(self, range: [f64; 2]) -> Self {
        Self { y: Some(range), ..self }
    }

    /// Ends of the y axis at any zoom.
    #[must_use]
    pub fn y_fixed(self, range: [f64; 2]) -> Self {
        Self { y: Some(range), fixed: true, ..self }
    }

    /// Ends of the y axis by the values without their spikes, and by what must be seen.
    #[must_use]
    pub fn y_without_spikes(self, seen: &[f64]) -> Self {
        let range = range_without_spikes(self.series.iter().flat_map(Series::values), seen);
        self.y(range)
    }

    /// Half as high as others.
    #[must_use]
    pub fn low(self) -> Self {
        Self { low: true, ..self }
    }

    /// With a tolerance: the stretch of y within it is shaded.
    #[must_use]
    pub fn tolerance(mut self, ends: [f64; 2]) -> Self {
        self.bands.push(ends);
        self
    }

    /// With a line across, and what it means.
    #[must_use]
    pub fn level(mut self, y: f64, words: impl Into<String>) -> Self {
        self.levels.push((y, words.into()));
        self
    }

    /// Whether there is nothing in it.
    pub fn is_empty(&self) -> bool {
        self.series.is_empty()
    }

    /// Whether any of its values is a number.
    pub fn has_values(&self) -> bool {
        self.series.iter().flat_map(Series::values).any(f64::is_finite)
    }
}

/// A stretch of x that is shaded, and its name.
#[derive(Clone, Debug, Serialize)]
pub struct Span {
    /// Its beginning.
    pub from: f64,
    /// Its end.
    pub to: f64,
    /// What it is.
    pub name: String,
}

/// Panels over one x axis, with what marks places on it.
#[derive(Clone, Debug)]
pub struct Plot {
    pub(crate) title: String,
    pub(crate) x_title: String,
    pub(crate) panels: Vec<Panel>,
    pub(crate) x: Option<[f64; 2]>,
    log: bool,
    group: String,
    spans: Vec<Span>,
    marks: Vec<(f64, String)>,
}

impl Plot {
    /// What it shows, for who does not see it, and what its x axis shows, with the unit: `time, s`.
    pub fn new(title: impl Into<String>, x_title: impl Into<String>) -> Self {
        Self {
            title: title.into(),
            x_title: x_title.into(),
            panels: Vec::new(),
            x: None,
            log: false,
            group: String::new(),
            spans: Vec::new(),
            marks: Vec::new(),
        }
    }

    /// With a panel; one without series is left out.
    #[must_use]
    pub fn panel(mut self, panel: Panel) -> Self {
        if !panel.is_empty() {
            self.panels.push(panel);
        }
        self
    }

    /// Ends of the x axis, where they are not to follow the data.
    #[must_use]
    pub fn x(self, range: [f64; 2]) -> Self {
        Self { x: Some(range), ..self }
    }

    /// With a logarithmic x axis.
    #[must_use]
    pub fn log_x(self) -> Self {
        Self { log: true, ..self }
    }

    /// Zooms and reads off together with all plots of the page that name the same group.
    #[must_use]
    pub fn group(self, group: impl Into<String>) -> Self {
        Self { group: group.into(), ..self }
    }

    /// With shaded stretches, such as phases.
    #[must_use]
    pub fn spans(mut self, spans: impl IntoIterator<Item = Span>) -> Self {
        self.spans.extend(spans);
        self
    }

    /// With a line at an x, and what it means.
    #[must_use]
    pub fn mark(mut self, x: f64, words: impl Into<String>) -> Self {
        self.marks.push((x, words.into()));
        self
    }

    /// Whether there is nothing in it.
    pub fn is_empty(&self) -> bool {
        self.panels.is_empty()
    }

    fn data(&self) -> Data<'_> {
        let all_x =
            || self.panels.iter().flat_map(|panel| &panel.series).flat_map(|series| &series.x).copied();
        let ends = all_x().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], x| [a.min(x), b.max(x)]);
        let shown = self.x.unwrap_or(ends);
        let longest = self.panels.iter().flat_map(|panel| &panel.series).map(|series| series.x.len()).max();
        let steps = (X_STEPS_PER_POINT * longest.unwrap_or(0) as f64).max(Y_STEPS / 10.0);
        let mut tables = Tables { places: places(shown, steps), known: HashMap::new(), all: Vec::new() };
        let panels = self
            .panels
            .iter()
            .map(|panel| {
                let values = panel.series.iter().flat_map(Series::values);
                let ends = panel.y.unwrap_or_else(|| range_without_spikes(values, &[]));
                let places = places(ends, if panel.low { Y_STEPS / 4.0 } else { Y_STEPS });
                let series = panel.series.iter().map(|series| SeriesData {
                    name: &series.name,
                    mark: series.mark,
                    colour: series.colour % crate::palette::SERIES,
                    x: tables.index_of(&series.x),
                    y: quantised(&series.high, places),
                    low: quantised(&series.low, places),
                });
                PanelData {
                    series: series.collect(),
                    places,
                    title: &panel.y_title,
                    y: panel.y.map(|ends| ends.map(|end| rounded(end, places + 1))),
                    fixed: panel.fixed,
                    low: panel.low,
                    bands: &panel.bands,
                    levels: &panel.levels,
                }
            })
            .collect();
        Data {
            x: &self.x_title,
            range: shown.map(|end| rounded(end, tables.places + 1)),
            log: self.log,
            group: &self.group,
            places: tables.places,
            panels,
            spans: &self.spans,
            marks: &self.marks,
            tables: tables.all,
        }
    }
}

/// In so many steps the length of an axis is told: a zoom of ten times still shows no steps.
const Y_STEPS: f64 = 1e4;
/// The same of x for each of the points, which are what is zoomed to.
const X_STEPS_PER_POINT: f64 = 5.0;

/// Places behind the point that tell so many steps of a range.
fn places([from, to]: [f64; 2], steps: f64) -> i32 {
    let step = (to - from).abs() / steps;
    if step.is_finite() && step > 0.0 { (-step.log10()).ceil().clamp(-12.0, 12.0) as i32 } else { 6 }
}

fn rounded(x: f64, places: i32) -> f64 {
    let scale = 10_f64.powi(places);
    let rounded = (x * scale).round() / scale;
    if rounded.is_finite() { rounded } else { x }
}

/// Values as whole numbers of the last place, each by its distance from the one before, which is short; a gap for what is not
/// finite.
fn quantised(values: &[f64], places: i32) -> Vec<Option<i64>> {
    let scale = 10_f64.powi(places);
    let mut last = 0;
    values
        .iter()
        .map(|x| {
            x.is_finite().then(|| {
                let value = (x * scale).round() as i64;
                value.saturating_sub(std::mem::replace(&mut last, value))
            })
        })
        .collect()
}

/// Places of x, each list of them told once, each place by its distance from the one before.
struct Tables {
    places: i32,
    known: HashMap<Vec<i64>, usize>,
    all: Vec<Vec<i64>>,
}

impl Tables {
    fn index_of(&mut self, x: &[f64]) -> usize {
        let scale = 10_f64.powi(self.places);
        let mut last = 0;
        let steps: Vec<i64> = x
            .iter()
            .map(|x| {
                let at = (x * scale).round() as i64;
                let step = at - last;
                last = at;
                step
            })
            .collect();
        if let Some(index) = self.known.get(&steps) {
            return *index;
        }
        self.known.insert(steps.clone(), self.all.len());
        self.all.push(steps);
        self.all.len() - 1
    }
}

/// A plot as the script of a page takes it.
#[derive(Serialize)]
struct Data<'a> {
    x: &'a str,
    range: [f64; 2],
    log: bool,
    group: &'a str,
    places: i32,
    panels: Vec<PanelData<'a>>,
    spans: &'a [Span],
    marks: &'a [(f64, String)],
    tables: Vec<Vec<i64>>,
}

#[derive(Serialize)]
struct PanelData<'a> {
    title: &'a str,
    places: i32,
    y: Option<[f64; 2]>,
    fixed: bool,
    low: bool,
    bands: &'a [[f64; 2]],
    levels: &'a [(f64, String)],
    series: Vec<SeriesData<'a>>,
}

#[derive(Serialize)]
struct SeriesData<'a> {
    name: &'a str,
    mark: Mark,
    colour: usize,
    /// Which of the tables.
    x: usize,
    y: Vec<Option<i64>>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    low: Vec<Option<i64>>,
}

impl Render for Plot {
    fn render(&self) -> Markup {
        if self.is_empty() {
            return html! {};
        }
        // Numbers and texts alone: nothing in it can fail to be told.
        let json = serde_json::to_string(&self.data()).unwrap_or_default();
        // Within a script the end of one is the only markup.
        let json = json.replace('<', "\\u003c");
        let heights = self.panels.iter().map(|panel| if panel.low { 6.5 } else { 10.5 });
        let height: f64 = heights.sum::<f64>() + 2.6;
        html! {
            figure.plot data-plot tabindex="0" role="group" aria-label=(self.title) style={ "--h:" (format!("{height:.1}")) "rem" } {
                noscript { p.soft { "Plots need JavaScript, which is switched off here." } }
                script type="application/json" { (PreEscaped(json)) }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        let at = |range| ticks(range, 3.0).into_iter().map(|(at, _)| at).collect::<Vec<_>>();
        assert_eq!(at([0.0, 0.61]), [0.0, 0.5]);
        assert_eq!(at([-1.2, 1.2]), [-1.0, 0.0, 1.0]);
        assert!(at([1.0, 1.0]).is_empty());
        assert!(at([f64::MIN, f64::MAX]).len() <= 21);
    }

    #[test]
    fn a_spike_does_not_rule_the_picture_but_a_step_does() {
        let spiked = (0..240).map(|i| if i == 200 { 50.0 } else { (f64::from(i) * 0.1).sin() });
        let [low, high] = range_without_spikes(spiked, &[]);
        assert!(high < 2.0 && low > -2.0, "{low} to {high}");
        let stepped = (0..240).map(|i| if i > 220 { 50.0 } else { (f64::from(i) * 0.1).sin() });
        assert!(range_without_spikes(stepped, &[])[1] >= 50.0);
        assert_eq!(range_without_spikes([], &[]), [0.0, 1.0]);
    }

    #[test]
    fn thinned_series_keep_peaks_gaps_and_their_order() {
        let at = |i: usize| match i {
            31_234 => 9.0,
            31_235 => -9.0,
            50_000..50_010 => f64::NAN,
            _ => (i as f64 * 0.01).sin(),
        };
        let points: Vec<(f64, f64)> = (0..60_000).map(|i| (i as f64 * 0.01, at(i))).collect();
        let series = Series::new("z", Mark::Line, 0, points);
        assert!(series.x.len() <= 2 * STRETCHES + 4, "{}", series.x.len());
        assert!(series.high.contains(&9.0) && series.high.contains(&-9.0), "peaks are lost");
        assert!(series.high.iter().any(|y| y.is_nan()), "the gap is closed");
        assert!(series.x.windows(2).all(|pair| pair[0] < pair[1]), "out of order");
    }

    fn data(plot: &Plot) -> serde_json::Value {
        let html = plot.render().into_string();
        let (_, rest) = html.split_once("application/json\">").unwrap();
        serde_json::from_str(rest.split_once("</script>").unwrap().0).unwrap()
    }

    #[test]
    fn data_are_whole_numbers_of_the_last_place_that_shows() {
        let series = |name: &str, mark| {
            Series::new(name, mark, 7, [(0.0, 0.25), (0.5, f64::NAN), (1.0, -0.123_456_789)])
        };
        let panel = Panel::new("z, m").with(series("a", Mark::Line)).with(series("b", Mark::Dots));
        let plot = Plot::new("t", "time, s").panel(panel).panel(Panel::new("empty"));
        let told = data(&plot);
        assert_eq!(told["panels"].as_array().unwrap().len(), 1);
        assert_eq!(told["tables"].as_array().unwrap().len(), 1, "equal places are told once");
        let places = told["panels"][0]["places"].as_i64().unwrap();
        assert_eq!(places, 5);
        assert_eq!(told["panels"][0]["series"][0]["y"], serde_json::json!([25_000, null, -12_346 - 25_000]));
        assert_eq!(told["panels"][0]["series"][1]["colour"], 1);
    }

    #[test]
    fn no_name_ends_the_script() {
        let panel =
            Panel::new("y").with(Series::new("</script><b>", Mark::Line, 0, [(0.0, 1.0), (1.0, 2.0)]));
        let plot = Plot::new("\"><b>", "x").panel(panel);
        assert_eq!(data(&plot)["panels"][0]["series"][0]["name"], "</script><b>");
        assert!(!plot.render().into_string().contains("<b>"));
    }
}
