//! Gives the shared library its soname: programs keep the version that they were linked with.

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    // The number is `RIVET_ABI` of src/abi.rs; a test compares the two.
    println!("cargo:rustc-cdylib-link-arg=-Wl,-soname,librivet.so.1");
}
