//! What hands a sweep to a cluster's own scheduler: a job array of Slurm, an indexed Job of Kubernetes.

use std::fmt::Write as _;

/// How a sweep is handed over.
#[derive(Clone, Debug)]
pub struct Handed<'a> {
    /// Name of the sweep.
    pub name: &'a str,
    /// The program, as the machines of the cluster find it.
    pub program: &'a str,
    /// The sweep's folder, as the machines of the cluster see it; absolute.
    pub folder: &'a str,
    /// How many shards.
    pub shards: u64,
    /// Cores of a shard.
    pub cores: u16,
}

/// A word as a shell takes it, whatever is in it.
fn quoted(word: &str) -> String {
    format!("'{}'", word.replace('\'', "'\\''"))
}

impl Handed<'_> {
    /// A name that schedulers take: a DNS label.
    pub fn job(&self) -> String {
        let plain = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '-' };
        let name: String = self.name.chars().map(plain).take(40).collect();
        format!("bench-sweep-{}", name.trim_matches('-')).trim_end_matches('-').to_owned()
    }

    /// The script of the job array. `options` are further lines of `#SBATCH`, such as `--partition=short`.
    pub fn slurm_array(&self, options: &[String]) -> String {
        let mut script = self.slurm_head(
            &[
                format!("--array=1-{}", self.shards),
                format!("--cpus-per-task={}", self.cores),
                // A preempted or lost task begins again, and skips what it has written.
                "--requeue".to_owned(),
                "--open-mode=append".to_owned(),
                format!("--output={}", self.log("shard-%a.log")),
            ],
            options,
        );
        let _ = writeln!(
            script,
            "exec {} --quiet sweep run {} --shard \"$SLURM_ARRAY_TASK_ID/{}\" --jobs \"${{SLURM_CPUS_PER_TASK:-{}}}\"",
            quoted(self.program),
            quoted(self.folder),
            self.shards,
            self.cores
        );
        script
    }

    /// The script that merges once the array is done.
    pub fn slurm_merge(&self, options: &[String]) -> String {
        let mut script = self
            .slurm_head(&["--requeue".to_owned(), format!("--output={}", self.log("merge.log"))], options);
        let _ = writeln!(script, "exec {} --quiet sweep merge {}", quoted(self.program), quoted(self.folder));
        script
    }

    /// Slurm takes options with quotation marks about what a space would part.
    fn log(&self, name: &str) -> String {
        // A percent sign of a folder's name is no pattern.
        format!("\"{}/slurm/{name}\"", self.folder.replace('%', "%%"))
    }

    fn slurm_head(&self, own: &[String], options: &[String]) -> String {
        let mut script = format!("#!/bin/bash\n#SBATCH --job-name={}\n", self.job());
        for option in own.iter().chain(options) {
            // Writing to a String cannot fail, here and below.
            let _ = writeln!(script, "#SBATCH {option}");
        }
        script
    }

    /// The manifest: an indexed Job, a pod for each shard, on a volume that all of them share. `image` has the program, `claim` is the
    /// volume's claim, which is mounted at `mount`; [`Handed::folder`] lies in it.
    pub fn kubernetes(&self, image: &str, claim: &str, mount: &str) -> String {
        let run = format!(
            "exec {} --quiet sweep run {} --shard \"$((JOB_COMPLETION_INDEX + 1))/{}\" --jobs {}",
            quoted(self.program),
            quoted(self.folder),
            self.shards,
            self.cores
        );
        let text = |text: &str| serde_json::Value::from(text).to_string();
        format!(
            "apiVersion: batch/v1
kind: Job
metadata:
  name: {job}
spec:
  completionMode: Indexed
  completions: {shards}
  parallelism: {shards}
  # A pod that was evicted begins again, and skips what it has written; one that fails by itself thrice is given up.
  backoffLimitPerIndex: 3
  maxFailedIndexes: 0
  podFailurePolicy:
    rules:
      - action: Ignore
        onPodConditions:
          - type: DisruptionTarget
            status: \"True\"
  template:
    metadata:
      labels:
        app: {job}
    spec:
      restartPolicy: Never
      containers:
        - name: shard
          image: {image}
          command: [\"/bin/sh\", \"-c\", {run}]
          resources:
            requests:
              cpu: \"{cores}\"
              memory: 300Mi
            limits:
              memory: 1Gi
          volumeMounts:
            - name: sweep
              mountPath: {mount}
      volumes:
        - name: sweep
          persistentVolumeClaim:
            claimName: {claim}
",
            job = self.job(),
            shards = self.shards,
            image = text(image),
            run = text(&run),
            cores = self.cores,
            mount = text(mount),
            claim = text(claim),
        )
    }
}

/// The file that an image with the program is built from, in a folder that holds the program as `bench`.
pub const CONTAINER_FILE: &str =
    "# podman build -t REGISTRY/bench . (or docker build), in a folder that holds the program and this file
FROM docker.io/library/debian:12-slim
COPY bench /usr/local/bin/bench
# Nobody in particular: the volume decides who may write.
USER 65532:65532
CMD [\"/usr/local/bin/bench\", \"--help\"]
";

#[cfg(test)]
mod tests {
    use super::*;

    const HANDED: Handed<'_> = Handed {
        name: "Röbust & more",
        program: "/opt/bench",
        folder: "/shared/it's here",
        shards: 8,
        cores: 2,
    };

    #[test]
    fn names_are_those_that_schedulers_take() {
        assert_eq!(HANDED.job(), "bench-sweep-r-bust---more");
        assert_eq!(Handed { name: "???", ..HANDED }.job(), "bench-sweep");
        let long = "x".repeat(100);
        assert!(Handed { name: &long, ..HANDED }.job().len() <= 63);
    }

    #[test]
    fn what_a_shell_reads_is_quoted() {
        let script = HANDED.slurm_array(&["--partition=short".to_owned()]);
        assert!(
            script.contains(
                "'/opt/bench' --quiet sweep run '/shared/it'\\''s here' --shard \"$SLURM_ARRAY_TASK_ID/8\""
            ),
            "{script}"
        );
        assert!(
            script.contains("#SBATCH --array=1-8\n") && script.contains("#SBATCH --partition=short\n"),
            "{script}"
        );
    }
}
