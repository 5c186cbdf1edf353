//! How far a command is: a bar on a terminal, without one a line on standard error every ten seconds, nothing with `--quiet`.

use std::{
    fmt::Write as _,
    io::IsTerminal,
    sync::{
        Arc, Condvar, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    thread,
    time::{Duration, Instant},
};

use indicatif::{ProgressBar, ProgressStyle};

static QUIET: AtomicBool = AtomicBool::new(false);

/// From here on neither progress nor notes are told. Warnings and errors are.
pub fn be_quiet() {
    QUIET.store(true, Ordering::Relaxed);
}

fn is_quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

/// Says what was done, such as which file was written.
pub fn note(words: &str) {
    if !is_quiet() {
        crate::words::say!("{words}");
    }
}

/// Between two lines without a terminal, and before the first.
const EVERY: Duration = Duration::from_secs(10);
/// Between two looks at the clock.
const LOOK: Duration = Duration::from_millis(200);
/// Steps of the bar.
const STEPS: u64 = 1000;

/// The progress of one command. Shown by a thread of its own, so that work that reports nothing for long is told too.
pub struct Progress {
    shared: Arc<Shared>,
    shows: Option<thread::JoinHandle<()>>,
}

struct Shared {
    began: Instant,
    told: Mutex<Told>,
    ended: Mutex<bool>,
    wake: Condvar,
    /// On a terminal.
    bar: Option<ProgressBar>,
}

impl Progress {
    /// Of a command, which begins every line.
    pub fn of(command: &'static str) -> Self {
        let bar = (!is_quiet() && std::io::stderr().is_terminal()).then(|| {
            let style = ProgressStyle::with_template("{bar:20} {wide_msg}");
            ProgressBar::new(STEPS).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
        });
        let shared = Arc::new(Shared {
            began: Instant::now(),
            told: Mutex::new(Told::new(command)),
            ended: Mutex::new(false),
            wake: Condvar::new(),
            bar,
        });
        let shows = (!is_quiet()).then(|| {
            let shared = Arc::clone(&shared);
            thread::Builder::new().name("progress".to_owned()).spawn(move || shared.show())
        });
        // Without a thread to spare, the work goes on untold.
        Self { shared, shows: shows.and_then(Result::ok) }
    }

    /// Something new begins, of which there is so much.
    pub fn begin(&self, what: &str, total: f64, unit: &'static str) {
        let now = self.shared.began.elapsed();
        self.shared.told().begin(now, what, Some(total), unit);
    }

    /// Something new begins that cannot say how far it is.
    pub fn begin_untold(&self, what: &str) {
        let now = self.shared.began.elapsed();
        self.shared.told().begin(now, what, None, "");
    }

    /// So much is done.
    pub fn at(&self, done: f64) {
        self.shared.told().done = done;
    }

    /// What is done at the moment, within the same work.
    pub fn doing(&self, what: &str) {
        what.clone_into(&mut self.shared.told().what);
    }

    /// So much was done before this command; it says nothing of how long the rest takes.
    pub fn resume_at(&self, done: f64) {
        let mut told = self.shared.told();
        (told.done, told.begun_at) = (done, done);
    }

    /// From here on tells how many are done in a second, too.
    pub fn with_rate(&self) {
        self.shared.told().tells_rate = true;
    }

    /// One more is done.
    pub fn step(&self) {
        self.shared.told().done += 1.0;
    }

    /// The share of all that the command does; the time left goes by it from here on.
    pub fn overall(&self, share: f64) {
        self.shared.told().overall = Some(share);
    }

    /// A line that stays.
    pub fn say(&self, words: &str) {
        match &self.shared.bar {
            Some(bar) => bar.suspend(|| crate::words::say!("{words}")),
            None => crate::words::say!("{words}"),
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        *unpoisoned(&self.shared.ended) = true;
        self.shared.wake.notify_all();
        if let Some(shows) = self.shows.take() {
            // That the screen failed is no reason for the work to fail.
            let _ = shows.join();
        }
        if let Some(bar) = &self.shared.bar {
            bar.finish_and_clear();
        }
    }
}

/// Words and numbers are whole at any time: a panic elsewhere spoils none.
fn unpoisoned<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shared {
    fn told(&self) -> MutexGuard<'_, Told> {
        unpoisoned(&self.told)
    }

    fn show(&self) {
        let mut ended = unpoisoned(&self.ended);
        while !*ended {
            let waited = self.wake.wait_timeout(ended, LOOK);
            ended = waited.unwrap_or_else(PoisonError::into_inner).0;
            let now = self.began.elapsed();
            let mut told = self.told();
            if let Some(bar) = &self.bar {
                bar.set_position((told.share().unwrap_or(0.0) * STEPS as f64) as u64);
                bar.set_message(told.words(now));
            } else if let Some(line) = told.due(now) {
                crate::words::say!("{line}");
            }
        }
    }
}

/// What is told, as a matter of the time since the command began.
struct Told {
    command: &'static str,
    what: String,
    unit: &'static str,
    done: f64,
    total: Option<f64>,
    overall: Option<f64>,
    tells_rate: bool,
    /// What was done when the work at hand began, and when that was.
    begun_at: f64,
    begun: Duration,
    last_line: Duration,
}

impl Told {
    fn new(command: &'static str) -> Self {
        Self {
            command,
            what: String::new(),
            unit: "",
            done: 0.0,
            total: None,
            overall: None,
            tells_rate: false,
            begun_at: 0.0,
            begun: Duration::ZERO,
            last_line: Duration::ZERO,
        }
    }

    fn begin(&mut self, now: Duration, what: &str, total: Option<f64>, unit: &'static str) {
        what.clone_into(&mut self.what);
        (self.done, self.total, self.unit) = (0.0, total, unit);
        (self.begun_at, self.begun) = (0.0, now);
    }

    /// How much of the command, or of the work at hand, is done.
    fn share(&self) -> Option<f64> {
        let at_hand = self.total.map(|total| if total > 0.0 { self.done / total } else { 1.0 });
        self.overall.or(at_hand).map(|share| share.clamp(0.0, 1.0))
    }

    /// The time left at the pace so far; too little done tells none.
    fn left(&self, now: Duration) -> Option<Duration> {
        const LEAST: f64 = 0.02;
        let share = self.share()?;
        let (since, before) = match (self.overall, self.total) {
            (Some(_), _) => (Duration::ZERO, 0.0),
            (None, total) => (self.begun, self.begun_at / total?),
        };
        let made = share - before;
        (made >= LEAST).then(|| now.saturating_sub(since).mul_f64((1.0 - share) / made))
    }

    fn words(&self, now: Duration) -> String {
        let mut words = format!("{}: {}", self.command, self.what);
        if let Some(total) = self.total {
            let comma = if self.what.is_empty() { "" } else { ", " };
            let done = self.done.min(total).round();
            words += format!("{comma}{done} of {} {}", total.round(), self.unit).trim_end();
        }
        let since_s = now.saturating_sub(self.begun).as_secs_f64();
        if self.tells_rate && self.done > self.begun_at && since_s > 0.0 {
            _ = write!(words, ", {} a second", bench_page::digits((self.done - self.begun_at) / since_s));
        }
        match self.left(now) {
            // Writing to a String cannot fail.
            Some(left) => _ = write!(words, ", about {} left", rounded(left)),
            None if self.total.is_none() => {
                _ = write!(words, ", {} so far", rounded(now.saturating_sub(self.begun)));
            }
            None => {}
        }
        words
    }

    /// The line that is due now, if one is.
    fn due(&mut self, now: Duration) -> Option<String> {
        if self.what.is_empty() && self.total.is_none() || now.saturating_sub(self.last_line) < EVERY {
            return None;
        }
        self.last_line = now;
        Some(self.words(now))
    }
}

/// A time as exact as it is worth.
fn rounded(time: Duration) -> String {
    match time.as_secs_f64() {
        s if s < 10.0 => format!("{:.0} s", s.ceil()),
        s if s < 90.0 => format!("{:.0} s", (s / 5.0).round() * 5.0),
        s if s < 5400.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seconds(s: f64) -> Duration {
        Duration::from_secs_f64(s)
    }

    #[test]
    fn a_line_comes_every_ten_seconds_and_none_before() {
        let mut told = Told::new("tune");
        assert_eq!(told.due(seconds(11.0)), None, "nothing has begun");
        told.begin(seconds(0.0), "altitude loop, scan", Some(400.0), "sets of gains");
        told.done = 39.0;
        assert_eq!(told.due(seconds(9.9)), None);
        told.done = 40.0;
        let line = told.due(seconds(15.0));
        assert_eq!(
            line.as_deref(),
            Some("tune: altitude loop, scan, 40 of 400 sets of gains, about 2 min left")
        );
        assert_eq!(told.due(seconds(24.9)), None);
        assert!(told.due(seconds(25.0)).is_some());
    }

    #[test]
    fn the_time_left_goes_by_what_was_done_here() {
        let mut told = Told::new("blind answer");
        told.begin(seconds(5.0), "", Some(100.0), "cases");
        (told.done, told.begun_at) = (50.0, 50.0);
        assert_eq!(told.words(seconds(5.0)), "blind answer: 50 of 100 cases");
        told.done = 60.0;
        assert_eq!(told.words(seconds(15.0)), "blind answer: 60 of 100 cases, about 40 s left");
        // Of several works, the whole counts.
        told.overall = Some(0.25);
        assert_eq!(told.words(seconds(15.0)), "blind answer: 60 of 100 cases, about 45 s left");
    }

    #[test]
    fn the_rate_goes_by_what_was_done_here_too() {
        let mut told = Told::new("sweep");
        told.begin(seconds(5.0), "running", Some(1000.0), "runs");
        (told.done, told.begun_at, told.tells_rate) = (500.0, 500.0, true);
        assert_eq!(told.words(seconds(5.0)), "sweep: running, 500 of 1000 runs");
        told.done = 600.0;
        let words = told.words(seconds(15.0));
        assert_eq!(words, "sweep: running, 600 of 1000 runs, 10 a second, about 40 s left");
    }

    #[test]
    fn what_cannot_say_how_far_it_is_says_for_how_long() {
        let mut told = Told::new("diagnose");
        told.begin(seconds(2.0), "weighing causes", None, "");
        assert_eq!(told.due(seconds(14.0)).as_deref(), Some("diagnose: weighing causes, 10 s so far"));
        told.begin(seconds(20.0), "", Some(0.0), "");
        assert_eq!(told.share(), Some(1.0), "nothing to do is done");
    }

    #[test]
    fn times_are_rounded_to_what_they_are_worth() {
        let told = [0.2, 12.0, 47.0, 100.0, 6000.0].map(|s| rounded(seconds(s)));
        assert_eq!(told, ["1 s", "10 s", "45 s", "2 min", "1.7 h"]);
    }
}
