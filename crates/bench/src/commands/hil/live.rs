use std::io::IsTerminal;

use bench_run::Progress;
use indicatif::{ProgressBar, ProgressStyle};
use rtrb::{Consumer, Producer, RingBuffer};

/// Iterations between two looks at the screen, at 1 kHz, with room.
const QUEUE: usize = 1024;

/// The line on the terminal that tells how the flight goes.
pub struct Live {
    progress: Consumer<Progress>,
    bar: ProgressBar,
    last: Option<Progress>,
    /// Largest lateness since the flight began, s.
    lateness_s: f64,
    unanswered: u64,
}

impl Live {
    /// The line, and the end of the queue that the loop feeds.
    pub fn new() -> (Producer<Progress>, Self) {
        let (producer, progress) = RingBuffer::new(QUEUE);
        let bar = ProgressBar::hidden();
        (producer, Self { progress, bar, last: None, lateness_s: 0.0, unanswered: 0 })
    }

    pub fn begin(&mut self, duration_s: f64) {
        if std::io::stderr().is_terminal() {
            let style = ProgressStyle::with_template("{bar:20} {percent}% {msg}")
                .unwrap_or_else(|_| ProgressStyle::default_bar());
            self.bar = ProgressBar::new((duration_s * 1000.0) as u64).with_style(style);
        }
    }

    /// Takes what has come from the loop, and shows the latest.
    pub fn draw(&mut self) {
        while let Ok(progress) = self.progress.pop() {
            self.lateness_s = self.lateness_s.max(progress.lateness_s);
            self.unanswered += u64::from(progress.round_trip_s.is_none());
            self.last = Some(progress);
        }
        let Some(now) = &self.last else { return };
        self.bar.set_position(now.now.nanos() / 1_000_000);
        let trip = now.round_trip_s.map_or("none".to_owned(), |s| format!("{:.2} ms", s * 1e3));
        self.bar.set_message(format!(
            "{} {:5.1} s  {:.2} m  throttle {:.2}  round trip {trip}  late at most {:.2} ms  lost {}",
            now.phase,
            now.now.seconds(),
            now.altitude_m,
            now.throttle,
            self.lateness_s * 1e3,
            self.unanswered
        ));
    }

    /// A line that stays.
    pub fn say(&self, words: &str) {
        self.bar.suspend(|| eprintln!("{words}"));
    }

    pub fn end(&self) {
        self.bar.finish_and_clear();
    }
}
