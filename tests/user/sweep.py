"""Reads a sweep's results with DuckDB and holds its manifest against the schema of Kubernetes; prints what it saw as JSON."""

import json
import sys
from pathlib import Path

import duckdb
import kubernetes_validate
import yaml

folder = Path(sys.argv[1])
results, timing = (str(folder / name) for name in ("results.parquet", "timing.parquet"))
runs, distinct, passed, with_lag, least, most = duckdb.execute(
    "select count(*), count(distinct id), count(*) filter (outcome = 'passed'), count(rotor_lag_time_constant_s),"
    " min(rotor_lag_time_constant_s), max(rotor_lag_time_constant_s) from read_parquet(?)",
    [results],
).fetchone()
(timed,) = duckdb.execute(
    "select count(*) from read_parquet(?) r join read_parquet(?) t using (id) where took_s > 0", [results, timing]
).fetchone()

manifest = yaml.safe_load((folder / "kubernetes/job.yaml").read_text())
kubernetes_validate.validate(manifest, "1.29", strict=True)
del manifest["spec"]["template"]["spec"]["containers"][0]["name"]
try:
    kubernetes_validate.validate(manifest, "1.29", strict=True)
    broken = "taken"
except kubernetes_validate.ValidationError:
    broken = "refused"

json.dump(
    {
        "runs": runs,
        "distinct": distinct,
        "passed": passed,
        "with_lag": with_lag,
        "least_lag": least,
        "most_lag": most,
        "timed": timed,
        "manifest_without_a_name": broken,
    },
    sys.stdout,
)
