use bench_run::Progress;
use rtrb::{Consumer, Producer, RingBuffer};

use crate::progress;

/// Iterations between two looks at the screen, at 1 kHz, with room.
const QUEUE: usize = 1024;

/// The line on the terminal that tells how the flight goes.
pub struct Screen {
    progress: Consumer<Progress>,
    /// While it flies.
    line: Option<progress::Progress>,
    last: Option<Progress>,
    /// Largest lateness since the flight began, s.
    lateness_s: f64,
    unanswered: u64,
}

impl Screen {
    /// The line, and the end of the queue that the loop feeds.
    pub fn new() -> (Producer<Progress>, Self) {
        let (producer, progress) = RingBuffer::new(QUEUE);
        (producer, Self { progress, line: None, last: None, lateness_s: 0.0, unanswered: 0 })
    }

    pub fn begin(&mut self, duration_s: f64) {
        let line = progress::Progress::of("hil");
        line.begin("flying", duration_s, "s");
        self.line = Some(line);
    }

    /// Takes what has come from the loop, and shows the latest; whether anything has come yet.
    pub fn draw(&mut self) -> bool {
        while let Ok(progress) = self.progress.pop() {
            self.lateness_s = self.lateness_s.max(progress.lateness_s);
            self.unanswered += u64::from(progress.round_trip_s.is_none());
            self.last = Some(progress);
        }
        let (Some(now), Some(line)) = (&self.last, &self.line) else { return false };
        line.at(now.now.seconds());
        let trip = now.round_trip_s.map_or("none".to_owned(), |s| format!("{:.2} ms", s * 1e3));
        line.doing(&format!(
            "{} at {:.2} m, throttle {:.2}, round trip {trip}, late at most {:.2} ms, lost {}",
            now.phase,
            now.altitude_m,
            now.throttle,
            self.lateness_s * 1e3,
            self.unanswered
        ));
        true
    }

    /// A line that stays.
    pub fn say(&self, words: &str) {
        match &self.line {
            Some(line) => line.say(words),
            None => crate::words::say!("{words}"),
        }
    }

    pub fn end(&mut self) {
        self.line = None;
    }
}
