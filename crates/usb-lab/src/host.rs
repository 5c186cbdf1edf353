//! Boots the kernel and runs a script in it.

use std::{
    env, fs, io,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    thread,
    time::{Duration, Instant},
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
    /// Time there is the guest's own and passes only while all of it waits, so that neither flights nor streams are late on a busy machine;
    /// a program that waits by going round for ever would stop it. It is ended after `patience`, in this machine's time.
    pub fn run(&self, work: &Path, script: &str, patience: Duration) -> io::Result<Outcome> {
        fs::write(work.join(SCRIPT), script)?;
        let _ = fs::remove_file(work.join(STATUS));
        let console_path = work.join("console");
        let console = fs::File::create(&console_path)?;
        let mut kernel = Command::new(&self.kernel);
        kernel
            .args(["mem=256M", "root=/dev/root", "rootfstype=hostfs", "rootflags=/", "rw"])
            // Time passes while the guest waits, and not while it computes: nothing there depends on how busy this machine is.
            .arg("time-travel=inf-cpu")
            // Page faults are dear there, so programs keep the memory that they have freed: half of the time.
            .args([
                "MALLOC_ARENA_MAX=1",
                "MALLOC_TRIM_THRESHOLD_=1000000000",
                "MALLOC_MMAP_THRESHOLD_=1000000000",
            ])
            .args(["con=null", "con0=null,fd:1", "quiet", "panic=-1"])
            .arg(format!("init={}", self.init.display()))
            .arg(format!("{WORK}={}", work.display()))
            // Its memory is a file there; a disk would be slow.
            .env("TMPDIR", "/dev/shm")
            .stdin(Stdio::null())
            .stdout(console.try_clone()?)
            .stderr(console);
        let mut child = kernel.spawn()?;
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
