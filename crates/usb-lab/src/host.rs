//! Boots the kernel and runs a script in it.

use std::{
    env, fs, io,
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadSchedulePolicy, set_thread_priority_and_policy,
    thread_native_id,
};

use crate::guest::{SCRIPT, STATUS, WORK};

/// Names the kernel that `kernel/build` made.
pub const KERNEL: &str = "BENCH_USB_KERNEL";

/// A kernel and the guest's first process.
#[derive(Clone, Debug)]
pub struct Lab {
    kernel: PathBuf,
    init: PathBuf,
}

/// How a script ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Outcome {
    /// Its exit code; `None` when it did not come to its end.
    pub status: Option<i32>,
    /// What kernel and script said on the console.
    pub console: String,
}

impl Lab {
    /// The kernel that the environment names, and a binary that calls [`crate::guest::main`]. `None` where no kernel is named.
    pub fn from_env(init: impl Into<PathBuf>) -> Option<Self> {
        let kernel = env::var_os(KERNEL)?.into();
        Some(Self { kernel, init: init.into() })
    }

    /// Boots and runs a shell script with `work` as its folder. The guest's root is this machine's file system, with what this user may do
    /// there, so that programs and their files are at hand by the same paths; `/dev`, `/proc`, `/sys` and `/run` are the guest's own.
    /// It is ended after `patience`.
    pub fn run(&self, work: &Path, script: &str, patience: Duration) -> io::Result<Outcome> {
        fs::write(work.join(SCRIPT), script)?;
        let _ = fs::remove_file(work.join(STATUS));
        let console_path = work.join("console");
        let console = fs::File::create(&console_path)?;
        let mut kernel = Command::new(&self.kernel);
        kernel
            .args(["mem=256M", "root=/dev/root", "rootfstype=hostfs", "rootflags=/", "rw"])
            .args(["con=null", "con0=null,fd:1", "quiet", "panic=-1"])
            .arg(format!("init={}", self.init.display()))
            .arg(format!("{WORK}={}", work.display()))
            // Its memory is a file there; a disk would be slow.
            .env("TMPDIR", "/dev/shm")
            .stdin(Stdio::null())
            .stdout(console.try_clone()?)
            .stderr(console);
        let mut child = first_of_all(kernel)?;
        let until = Instant::now() + patience;
        while child.try_wait()?.is_none() {
            if Instant::now() > until {
                child.kill()?;
                child.wait()?;
            } else {
                thread::sleep(Duration::from_millis(20));
            }
        }
        let status = fs::read_to_string(work.join(STATUS)).ok().and_then(|text| text.trim().parse().ok());
        let console = String::from_utf8_lossy(&fs::read(console_path)?).into_owned();
        Ok(Outcome { status, console })
    }
}

/// Starts a program before all ordinary ones, where that is granted: a USB does not wait for this machine's other work. It inherits that
/// from the thread that starts it.
fn first_of_all(mut program: Command) -> io::Result<Child> {
    let start = move || {
        let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::RoundRobin);
        // What is refused costs time, and nothing else.
        if let Ok(least) = ThreadPriority::try_from(1) {
            let _ = set_thread_priority_and_policy(thread_native_id(), least, policy);
        }
        program.spawn()
    };
    thread::spawn(start).join().map_err(|_| io::Error::other("the thread that starts the kernel failed"))?
}
