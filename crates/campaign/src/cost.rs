//! What a sweep takes on a cluster: the arithmetic of `docs/scale.md`, which a simulation in this file's tests checks.

/// What is known of the runs and of the machines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Workload {
    /// Runs of the plan.
    pub runs: u64,
    /// Time of a run on one core, s.
    pub run_s: f64,
    /// Runs that are written together: what an interruption loses at most.
    pub runs_per_write: u64,
    /// Time that a write takes, s.
    pub write_s: f64,
    /// Shards, each on a core of its own.
    pub shards: u64,
    /// Standard deviation of the natural logarithm of how slow a core is; 0: all are alike.
    pub slowness_ln: f64,
    /// Interruptions of a shard, each hour of its work: preemptions, requeues, broken machines.
    pub interruptions_per_hour: f64,
    /// From an interruption until the shard runs again, s.
    pub restart_s: f64,
}

/// What it takes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cost {
    /// Core hours, lost work and waiting for restarts included.
    pub core_hours: f64,
    /// From the first start to the last end, h.
    pub wall_hours: f64,
    /// Share of the core hours that interruptions cost.
    pub lost_share: f64,
}

impl Workload {
    /// The expected cost. Interruptions are a Poisson process, and what is not written when one comes is done again: the time of each
    /// write's work is then `e^(restart rate) (e^(work rate) - 1) / rate` (Daly, A higher order estimate of the optimum checkpoint interval
    /// for restart dumps, Future Generation Computer Systems 22(3), 2006, equation 20). The slowest of n shards is put at the slowness
    /// that one in n + 1 exceeds (Blom, Statistical Estimates and Transformed Beta-Variables, 1958, section 6), within 10 % of it.
    pub fn cost(&self) -> Cost {
        let per_shard = self.runs.div_ceil(self.shards.max(1)) as f64;
        let writes = per_shard / self.runs_per_write.max(1) as f64;
        let work_s = |slow: f64| self.runs_per_write as f64 * self.run_s * slow + self.write_s;
        let rate = self.interruptions_per_hour / 3600.0;
        let with_losses = |slow: f64| {
            let plain = work_s(slow);
            let once = if rate > 0.0 {
                (rate * self.restart_s).exp() * (rate * plain).exp_m1() / rate
            } else {
                plain
            };
            writes * once
        };
        // The mean of a log-normal slowness whose median is 1.
        let mean_slow = (0.5 * self.slowness_ln.powi(2)).exp();
        let shard_s = with_losses(mean_slow);
        let slowest = (self.slowness_ln * normal_quantile_of_largest(self.shards)).exp();
        let plain_s = writes * work_s(mean_slow);
        Cost {
            core_hours: self.shards as f64 * shard_s / 3600.0,
            wall_hours: with_losses(slowest) / 3600.0,
            lost_share: 1.0 - plain_s / shard_s,
        }
    }
}

/// Where the largest of `n` standard normal values is expected: the quantile of `(n - 0.375) / (n + 0.25)` (Blom 1958).
fn normal_quantile_of_largest(n: u64) -> f64 {
    let n = n.max(1) as f64;
    bench_statistics::normal_quantile((n - 0.375) / (n + 0.25))
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Exp, StandardNormal};

    use super::*;

    /// Core and wall seconds of one sweep: every shard computes write by write, is interrupted now and then, waits, and begins the write
    /// again.
    fn simulated(of: &Workload, rng: &mut ChaCha8Rng) -> [f64; 2] {
        let until_next =
            (of.interruptions_per_hour > 0.0).then(|| Exp::new(of.interruptions_per_hour / 3600.0).unwrap());
        let (mut core_s, mut wall_s) = (0.0, 0.0_f64);
        for _ in 0..of.shards {
            let slow = (of.slowness_ln * rng.sample::<f64, _>(StandardNormal)).exp();
            let writes = of.runs.div_ceil(of.shards).div_ceil(of.runs_per_write);
            let mut shard_s = 0.0;
            for _ in 0..writes {
                let work_s = of.runs_per_write as f64 * of.run_s * slow + of.write_s;
                let (mut ahead_s, mut is_restart) = (work_s, false);
                loop {
                    let next_s = until_next.map_or(f64::INFINITY, |until_next| rng.sample(until_next));
                    if next_s < ahead_s {
                        // What was done of this write is lost, and so is a restart that is itself interrupted.
                        shard_s += next_s;
                        (ahead_s, is_restart) = (of.restart_s, true);
                    } else {
                        shard_s += ahead_s;
                        if !is_restart {
                            break;
                        }
                        (ahead_s, is_restart) = (work_s, false);
                    }
                }
            }
            core_s += shard_s;
            wall_s = wall_s.max(shard_s);
        }
        [core_s, wall_s]
    }

    const MILLION: Workload = Workload {
        runs: 1_000_000,
        run_s: 2.0,
        runs_per_write: 50,
        write_s: 0.1,
        shards: 100,
        slowness_ln: 0.0,
        interruptions_per_hour: 0.0,
        restart_s: 60.0,
    };

    /// The means of 40 sweeps, core and wall hours, each with its standard error.
    fn means(of: &Workload) -> [(f64, f64); 2] {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let sweeps: Vec<[f64; 2]> = (0..40).map(|_| simulated(of, &mut rng)).collect();
        [0, 1].map(|which| {
            let n = sweeps.len() as f64;
            let mean = sweeps.iter().map(|sweep| sweep[which] / 3600.0).sum::<f64>() / n;
            let variance =
                sweeps.iter().map(|sweep| (sweep[which] / 3600.0 - mean).powi(2)).sum::<f64>() / (n - 1.0);
            (mean, (variance / n).sqrt())
        })
    }

    fn agrees(cost: f64, (mean, error): (f64, f64), share: f64) {
        let room = 4.0 * error + share * mean + 1e-9;
        assert!((cost - mean).abs() < room, "{cost} h by the model, {mean} +- {error} h simulated");
    }

    #[test]
    fn without_trouble_it_is_a_product() {
        let cost = MILLION.cost();
        // 1e6 runs of 2 s and 20,000 writes of 0.1 s.
        assert!((cost.core_hours - 2_002_000.0 / 3600.0).abs() < 1e-6, "{cost:?}");
        assert!((cost.wall_hours - cost.core_hours / 100.0).abs() < 1e-9 && cost.lost_share.abs() < 1e-12);
    }

    #[test]
    fn interruptions_cost_what_a_simulation_says() {
        // A spot market at its worst: a shard lives half an hour.
        let of = Workload { interruptions_per_hour: 2.0, ..MILLION };
        let [core, _] = means(&of);
        agrees(of.cost().core_hours, core, 0.0);
        assert!(of.cost().lost_share > 0.05, "{:?}", of.cost());
    }

    #[test]
    fn the_slowest_shard_is_where_a_simulation_says() {
        for shards in [8, 100, 1000] {
            let of = Workload { slowness_ln: 0.2, shards, ..MILLION };
            let [core, wall] = means(&of);
            agrees(of.cost().core_hours, core, 0.0);
            agrees(of.cost().wall_hours, wall, 0.1);
        }
    }

    #[test]
    fn slow_and_interrupted_shards_cost_what_a_simulation_says() {
        let of = Workload { slowness_ln: 0.2, interruptions_per_hour: 0.5, ..MILLION };
        let [core, wall] = means(&of);
        // The law is not linear in the slowness, which the mean slowness leaves out: by the second term of exp, less than 1 %.
        agrees(of.cost().core_hours, core, 0.01);
        agrees(of.cost().wall_hours, wall, 0.1);
    }
}
