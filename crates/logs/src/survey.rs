//! What a log holds, without what it says: the first of two readings, from which a map is chosen.

use std::{collections::BTreeMap, ops::ControlFlow, path::Path};

use crate::{Cell, Format, LogError, Losses, Sample, TableForm, Topic, Visitor, scan};

/// What a log holds.
#[derive(Clone, Debug, Default)]
pub struct Survey {
    /// In the order of their first samples.
    pub topics: Vec<Surveyed>,
    /// The autopilot's parameters, by name; the last value of each.
    pub parameters: BTreeMap<String, f64>,
    /// What the log says of itself, by key.
    pub about: BTreeMap<String, String>,
    /// What is lost.
    pub losses: Losses,
}

/// A topic and what came of it.
#[derive(Clone, Debug)]
pub struct Surveyed {
    /// The topic.
    pub topic: Topic,
    /// How many samples.
    pub samples: u64,
    /// The earliest and the latest stamp, ns; `None` in tables.
    pub span_ns: Option<[i128; 2]>,
    /// The least and the greatest finite number of each field, in the fields' order; `None` where there is none.
    pub ranges: Vec<Option<[f64; 2]>>,
}

impl Survey {
    /// Reads a log for what it holds. With `ranges` every number is looked at.
    pub fn of(path: &Path, format: Format, form: TableForm, ranges: bool) -> Result<Self, LogError> {
        let mut surveyor = Surveyor { survey: Self::default(), ranges };
        let losses = scan(path, format, form, &mut surveyor)?;
        Ok(Self { losses, ..surveyor.survey })
    }

    /// Reads a log until every topic was told once and no further than a table's header.
    pub fn of_header(path: &Path, form: TableForm) -> Result<Self, LogError> {
        struct Header(Survey);
        impl Visitor for Header {
            fn topic(&mut self, topic: &Topic) -> Option<Vec<usize>> {
                self.0.topics.push(Surveyed::new(topic));
                None
            }

            fn sample(&mut self, _: Sample<'_>) -> ControlFlow<()> {
                ControlFlow::Break(())
            }
        }
        let mut header = Header(Self::default());
        scan(path, Format::Csv, form, &mut header)?;
        Ok(header.0)
    }

    /// How long it lasts by its stamps, s.
    pub fn duration_s(&self) -> f64 {
        let spans = self.topics.iter().filter_map(|topic| topic.span_ns);
        let whole = spans.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]);
        whole.map_or(0.0, |[first, last]| (last - first) as f64 * 1e-9)
    }
}

impl Surveyed {
    fn new(topic: &Topic) -> Self {
        let ranges = vec![None; topic.fields.len()];
        Self { topic: topic.clone(), samples: 0, span_ns: None, ranges }
    }
}

struct Surveyor {
    survey: Survey,
    ranges: bool,
}

impl Visitor for Surveyor {
    fn topic(&mut self, topic: &Topic) -> Option<Vec<usize>> {
        self.survey.topics.push(Surveyed::new(topic));
        Some(if self.ranges { (0..topic.fields.len()).collect() } else { Vec::new() })
    }

    fn sample(&mut self, sample: Sample<'_>) -> ControlFlow<()> {
        let topic = &mut self.survey.topics[sample.topic];
        topic.samples += 1;
        if let Some(time) = sample.time_ns {
            let [first, last] = topic.span_ns.get_or_insert([time; 2]);
            *first = time.min(*first);
            *last = time.max(*last);
        }
        for (range, cell) in topic.ranges.iter_mut().zip(sample.cells) {
            let number = match cell {
                Cell::Number(number) => *number,
                Cell::Integer(number) => *number as f64,
                Cell::Text(text) => str::from_utf8(text)
                    .ok()
                    .and_then(|text| text.trim().parse().ok())
                    .unwrap_or(f64::NAN),
                Cell::Absent => continue,
            };
            if number.is_finite() {
                let [low, high] = range.get_or_insert([number; 2]);
                *low = number.min(*low);
                *high = number.max(*high);
            }
        }
        ControlFlow::Continue(())
    }

    fn parameter(&mut self, name: &str, value: f64) {
        self.survey.parameters.insert(name.to_owned(), value);
    }

    fn about(&mut self, key: &str, value: &str) {
        self.survey.about.insert(key.to_owned(), value.to_owned());
    }
}
