//! Betaflight's and INAV's blackbox, decoded by `blackbox-log`: the frames of the loop as the topic `main`, what changes slowly as
//! `slow`, GPS as `gps`.
//!
//! Numbers are handed over as the firmware logs them, with predictors undone: hundredths of a volt and of an ampere, centimetres.

use std::{fs, ops::ControlFlow, path::Path};

use blackbox_log::{
    File, Headers, ParserEvent,
    frame::{Frame, FrameDef},
};

use crate::{Cell, Field, Format, LogError, Losses, Sample, Topic, Visitor, bytes::unread};

pub(crate) fn scan(path: &Path, part: Option<usize>, visitor: &mut dyn Visitor) -> Result<Losses, LogError> {
    let bytes = fs::read(path).map_err(|source| unread(path, source))?;
    let file = File::new(&bytes);
    let count = file.log_count();
    let index = match (part, count) {
        (None, 1) => 0,
        (None, count) => return Err(LogError::SeveralParts { path: path.to_owned(), count }),
        (Some(part), count) if (1..=count).contains(&part) => part - 1,
        (Some(part), count) => return Err(LogError::NoSuchPart { path: path.to_owned(), part, count }),
    };
    let headers = file.parse(index).and_then(Result::ok);
    let headers = match headers {
        Some(headers) => headers,
        None => {
            let source = file.parse(index).and_then(Result::err).map(Into::into);
            let detail = "its header cannot be used; Betaflight 4.2 to 4.5 and INAV 5 to 8 are read".to_owned();
            return Err(LogError::Malformed { path: path.to_owned(), format: Format::Blackbox.words(), detail, source });
        }
    };
    visitor.about("firmware", headers.firmware_revision());
    visitor.about("craft", headers.craft_name().unwrap_or_default());
    for (name, value) in headers.unknown() {
        if let Ok(value) = value.parse() {
            visitor.parameter(name, value);
        }
    }
    Ok(frames(&headers, visitor))
}

/// A kind of frame as a topic.
struct Stream {
    wanted: Option<Vec<(usize, bool)>>,
    samples: u64,
}

impl Stream {
    fn new<'data, D: FrameDef<'data>>(name: &str, definition: &D, visitor: &mut dyn Visitor) -> Self {
        let (mut fields, mut signed) = (Vec::new(), Vec::new());
        for field in definition.iter() {
            fields.push(Field::new(field.name));
            signed.push(field.signed);
        }
        let wanted = visitor.topic(&Topic { name: name.to_owned(), kind: String::new(), fields });
        let wanted = wanted.map(|wanted| wanted.into_iter().map(|place| (place, signed[place])).collect());
        Self { wanted, samples: 0 }
    }

    fn take<F: Frame>(
        &mut self,
        topic: usize,
        frame: &F,
        micros: u64,
        visitor: &mut dyn Visitor,
    ) -> ControlFlow<()> {
        self.samples += 1;
        let Some(wanted) = &self.wanted else { return ControlFlow::Continue(()) };
        let cells: Vec<Cell<'_>> = wanted
            .iter()
            .map(|&(place, signed)| match frame.get_raw(place) {
                Some(raw) if signed => Cell::Integer(raw.cast_signed().into()),
                Some(raw) => Cell::Integer(raw.into()),
                None => Cell::Absent,
            })
            .collect();
        let time_ns = Some(i128::from(micros) * 1000);
        visitor.sample(Sample { topic, time_ns, cells: &cells, line: self.samples, torn: None })
    }
}

fn frames(headers: &Headers<'_>, visitor: &mut dyn Visitor) -> Losses {
    let mut main = Stream::new("main", headers.main_frame_def(), visitor);
    let mut slow = Stream::new("slow", headers.slow_frame_def(), visitor);
    let mut gps = headers.gps_frame_def().map(|definition| Stream::new("gps", definition, visitor));
    let mut parser = headers.data_parser();
    let mut micros = 0;
    let mut last_iteration: Option<u32> = None;
    let mut losses = Losses::default();
    let mut steps = None;
    while let Some(event) = parser.next() {
        let flow = match event {
            ParserEvent::Main(frame) => {
                micros = frame.time_raw();
                let iteration = frame.iteration();
                // Frames are so many iterations apart; twice as many and more is a gap.
                if let Some(last) = last_iteration {
                    let step = iteration.wrapping_sub(last);
                    let least = steps.get_or_insert(step);
                    *least = step.min(*least).max(1);
                    losses.damaged += u64::from((step / *least).saturating_sub(1));
                }
                last_iteration = Some(iteration);
                main.take(0, &frame, micros, visitor)
            }
            ParserEvent::Slow(frame) => slow.take(1, &frame, micros, visitor),
            ParserEvent::Gps(frame) => match &mut gps {
                Some(gps) => gps.take(2, &frame, frame.time_raw(), visitor),
                None => ControlFlow::Continue(()),
            },
            ParserEvent::Event(_) => ControlFlow::Continue(()),
        };
        if flow == ControlFlow::Break(()) {
            return losses;
        }
    }
    losses.cut = !parser.is_done();
    losses
}
