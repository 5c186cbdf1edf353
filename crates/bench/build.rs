//! Builds the program anew when a file is added to the rigs that are embedded in it.

fn main() {
    println!("cargo::rerun-if-changed=../../rigs");
}
