//! Prints `docs/robot-toml.md`.

fn main() {
    print!("{}", rivet_config::keys::reference());
}
