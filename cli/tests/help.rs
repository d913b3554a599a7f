//! What `rivet --help` says. That this package has a test of its program also makes a test run of the workspace build it, with the same
//! features as everything else: the tests of the whole use that one.

use std::process::Command;

/// Every command by its name, in lines that fit a terminal of 100 columns.
#[test]
fn help_names_the_commands_and_fits() {
    let output = Command::new(env!("CARGO_BIN_EXE_rivet")).arg("--help").output().expect("the program starts");
    assert!(output.status.success());
    let text = String::from_utf8_lossy(&output.stdout);
    for command in ["demo", "identify", "diagnose", "predict", "doctor", "study", "figures", "blind", "monitor"] {
        assert!(text.lines().any(|line| line.split_whitespace().next() == Some(command)), "{command}: {text}");
    }
    assert!(text.lines().all(|line| line.chars().count() <= 100), "{text}");
}

/// A page for every command that help names, and completions that know them.
#[test]
fn man_pages_and_completions_cover_the_commands() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = || Command::new(env!("CARGO_BIN_EXE_rivet")).arg("generate").arg(folder.path()).output().expect("starts");
    // Twice: what is there is replaced.
    for _ in 0..2 {
        let output = run();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
    let read = |path: &str| std::fs::read_to_string(folder.path().join(path)).expect(path);
    let scripts =
        ["bash-completion/completions/rivet.bash", "zsh/site-functions/_rivet", "fish/vendor_completions.d/rivet.fish"]
            .map(read);
    for command in ["demo", "identify", "diagnose", "check", "control", "doctor", "monitor"] {
        let page = read(&format!("man/man1/rivet-{command}.1"));
        assert!(page.starts_with(".ie") && page.contains(".SH OPTIONS"), "{command}: {page}");
        assert!(scripts.iter().all(|script| script.contains(command)), "{command}");
    }
    // Programs that are built apart: their own options, and those that bridges share.
    for (command, options) in
        [("view", ["--layout", "--port", "--seconds"]), ("ros2", ["--domain", "--setpoint-type", "--seconds"])]
    {
        let page = read(&format!("man/man1/rivet-{command}.1")).replace('\\', "");
        for option in options {
            assert!(page.contains(option), "{command} {option}: {page}");
            // In fish an option stands without its hyphens.
            let known = scripts.iter().all(|script| script.contains(option.trim_start_matches('-')));
            assert!(known, "{command} {option}");
        }
    }
    assert!(read("man/man1/rivet.1").contains("rivet\\-diagnose(1)"), "the first page names the others");
    assert!(read("man/man1/rivet-study-real.1").contains("rivet"), "commands of commands have pages too");
}
