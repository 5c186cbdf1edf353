# `just` lists the recipes; CI runs the same (`.ci/run`).

# Fly the virtual airframe and record it
sim *ARGS:
    cargo run --release -- sim {{ARGS}}

# Every test, with what they need set up
test *ARGS:
    tests/run {{ARGS}}

# Format, lints and documentation, warnings denied
check:
    cargo fmt --all --check
    cargo clippy --workspace --all-targets --locked -- -D warnings
    RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps --locked

# Licences, sources, bans and advisories of the dependencies
deny:
    cargo deny check bans licenses sources advisories

# The Debian package, and its debug information in another one
deb:
    tools/deb

# Speed: the benches, then the table beside MuJoCo (docs/performance.md)
bench:
    cargo bench --workspace
    tools/performance

# All that CI runs
ci *ARGS:
    .ci/run {{ARGS}}
