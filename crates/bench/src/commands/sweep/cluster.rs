//! Sweeps handed to a cluster's own scheduler.

use std::{
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, bail};
use bench_campaign::{CONTAINER_FILE, Handed, Store};
use clap::Args;

use super::read;
use crate::{
    arguments::Force,
    exit::Exit,
    files::{self, Form, Outputs},
    progress, words,
};

/// Submit a sweep to Slurm: a job array, a task for each shard, and a job that merges when all are done
#[derive(Args)]
#[command(after_help = "Examples:
  bench sweep slurm my-plan.toml -o /shared/results --shards 100
  bench sweep slurm my-plan.toml -o /shared/results --shards 100 --option=--partition=short
  bench sweep slurm my-plan.toml -o shares/ --shards 8 --no-submit

The folder and this program must be there, under the same names, on every machine that Slurm may
choose. Tasks that are preempted begin again by themselves and skip what they have written.")]
pub struct SlurmArguments {
    /// Plan: a file, or the name of a built-in one
    plan: PathBuf,
    /// Folder of the results, on a disk that all machines share
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,
    /// Tasks of the array, each an equal share
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u64).range(1..=100_000))]
    shards: u64,
    /// Cores of each task
    #[arg(long, value_name = "COUNT", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=1024))]
    cores: u16,
    /// A further option of sbatch, such as --option=--partition=short; may be repeated
    #[arg(long = "option", value_name = "OPTION", allow_hyphen_values = true)]
    options: Vec<String>,
    /// Write the scripts, and do not run sbatch
    #[arg(long)]
    no_submit: bool,
}

pub fn slurm(arguments: &SlurmArguments) -> anyhow::Result<Exit> {
    if let Some(option) = arguments.options.iter().find(|option| option.contains(['\n', '\r'])) {
        bail!("--option {option:?} has more than one line; repeat --option");
    }
    let plan = read(&arguments.plan)?;
    check_shards(arguments.shards, plan.parts(), &plan.file().name)?;
    let store = Store::begin(&arguments.output, plan)?;
    let folder = absolute(store.folder())?;
    let program = std::env::current_exe().context("cannot find this program's own file")?;
    let handed = Handed {
        name: &store.plan().file().name,
        program: &program.display().to_string(),
        folder: &folder.display().to_string(),
        shards: arguments.shards,
        cores: arguments.cores,
    };
    let (array, merge) = (folder.join("slurm/array.sbatch"), folder.join("slurm/merge.sbatch"));
    files::write_and_say(&array, &handed.slurm_array(&arguments.options))?;
    files::write_and_say(&merge, &handed.slurm_merge(&arguments.options))?;
    if arguments.no_submit {
        return Ok(Exit::Done);
    }
    let job = sbatch(&[], &array)?;
    let merging = sbatch(&[&format!("--dependency=afterok:{job}")], &merge)?;
    words::print(&format!(
        "submitted {} of {} as job {job}, and their merging as job {merging}",
        words::count(arguments.shards, "shard"),
        store.plan().file().name
    ))?;
    Ok(Exit::Done)
}

/// Shares without any part of the work would be given a machine for nothing.
fn check_shards(shards: u64, parts: u64, name: &str) -> anyhow::Result<()> {
    if shards > parts {
        bail!(
            "--shards {shards}: {name} has {}, so some shards would have nothing to do; ask for fewer, or give the plan a smaller `runs_per_part`",
            words::count(parts, "part")
        );
    }
    Ok(())
}

fn absolute(folder: &Path) -> anyhow::Result<PathBuf> {
    folder.canonicalize().with_context(|| format!("cannot read {}", folder.display()))
}

/// Submits a script; gives the job's number.
fn sbatch(options: &[&str], script: &Path) -> anyhow::Result<String> {
    let output = Command::new("sbatch").arg("--parsable").args(options).arg(script).output();
    let output = output.with_context(|| {
        format!(
            "cannot run sbatch; the scripts are beside {}: submit them on a machine of the cluster, or say --no-submit",
            script.display()
        )
    })?;
    if !output.status.success() {
        bail!("sbatch refused {}: {}", script.display(), String::from_utf8_lossy(&output.stderr).trim());
    }
    // With several clusters their name follows behind a semicolon.
    let told = String::from_utf8_lossy(&output.stdout);
    Ok(told.trim().split(';').next().unwrap_or_default().to_owned())
}

/// Write what runs a sweep on Kubernetes: the manifest of an indexed Job, and the file that its image is built from
#[derive(Args)]
#[command(after_help = "Examples:
  bench sweep kubernetes my-plan.toml -o pods/ --shards 8 --image lab/bench:1 --claim shared
  kubectl apply -f pods/kubernetes/job.yaml

Copy the folder to the volume, under --mount; the pods write their results there. Then
`bench sweep merge` on the folder puts them together, wherever the volume can be seen.")]
pub struct KubernetesArguments {
    /// Plan: a file, or the name of a built-in one
    plan: PathBuf,
    /// Folder of the sweep to begin
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,
    /// Pods, each an equal share
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u64).range(1..=100_000))]
    shards: u64,
    /// Cores of each pod
    #[arg(long, value_name = "COUNT", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=1024))]
    cores: u16,
    /// Image with the program, as the cluster finds it
    #[arg(long, value_name = "IMAGE")]
    image: String,
    /// Claim of the volume that all pods share: one that many may write to
    #[arg(long, value_name = "NAME")]
    claim: String,
    /// Where pods see the volume; the sweep's folder is looked for in it
    #[arg(long, value_name = "PATH", default_value = "/sweep")]
    mount: String,
    #[command(flatten)]
    force: Force,
}

pub fn kubernetes(arguments: &KubernetesArguments) -> anyhow::Result<Exit> {
    let plan = read(&arguments.plan)?;
    check_shards(arguments.shards, plan.parts(), &plan.file().name)?;
    let [manifest, container] =
        ["job.yaml", "Containerfile"].map(|name| arguments.output.join("kubernetes").join(name));
    let outputs = Outputs::new(arguments.force.force);
    outputs.and(manifest.as_path(), Form::Any).and(container.as_path(), Form::Any).check()?;
    let store = Store::begin(&arguments.output, plan)?;
    let name = absolute(store.folder())?;
    let name =
        name.file_name().context("the folder has no name; name another")?.to_string_lossy().into_owned();
    let handed = Handed {
        name: &store.plan().file().name,
        program: "/usr/local/bin/bench",
        folder: &format!("{}/{name}", arguments.mount.trim_end_matches('/')),
        shards: arguments.shards,
        cores: arguments.cores,
    };
    files::write_and_say(
        &manifest,
        &handed.kubernetes(&arguments.image, &arguments.claim, &arguments.mount),
    )?;
    files::write_and_say(&container, CONTAINER_FILE)?;
    progress::note(&format!(
        "copy {} to the volume, then kubectl apply -f {}",
        store.folder().display(),
        manifest.display()
    ));
    Ok(Exit::Done)
}
