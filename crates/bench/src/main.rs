//! `bench`: what it does stands in the library, which the Python package calls too.

fn main() -> std::process::ExitCode {
    bench_cli::main()
}
