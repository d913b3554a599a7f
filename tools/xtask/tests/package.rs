//! The Debian package: built by `cargo xtask deb`, unpacked and read. Skipped where cargo-deb is not installed.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Says that something was not tested, past the test harness.
fn skipped(why: &str) {
    let _ = writeln!(std::io::stderr(), "SKIPPED: {why}");
}

fn runs(program: &str, arguments: &[&str]) -> bool {
    Command::new(program).args(arguments).output().is_ok_and(|output| output.status.success())
}

/// What a command printed; a failure is the test's.
fn succeed(command: &mut Command) -> String {
    let output = command.output().unwrap_or_else(|why| panic!("{command:?}: {why}"));
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?} ended with {}\n{errors}", output.status);
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Every file below a folder, by its path from there.
fn files(folder: &Path, root: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path());
    let below = |path: PathBuf| {
        let is_folder = path.is_dir() && !path.is_symlink();
        let name = || path.strip_prefix(root).expect("below").to_string_lossy().into_owned();
        if is_folder { files(&path, root) } else { vec![name()] }
    };
    let mut all: Vec<String> = entries.flat_map(below).collect();
    all.sort();
    all
}

#[test]
fn package_holds_what_is_installed_and_starts_nothing() {
    if !runs(env!("CARGO"), &["deb", "--version"]) {
        return skipped("cargo-deb is not installed: the Debian package is not built (docs/packages.md)");
    }
    if !runs("dpkg-deb", &["--version"]) {
        return skipped("dpkg-deb does not run: the Debian package is not built");
    }
    let folder = tempfile::tempdir().expect("a folder");
    let xtask = env!("CARGO_BIN_EXE_xtask");
    succeed(Command::new(xtask).args(["deb", "--fast", "--output"]).arg(folder.path().join("rivet.deb")));
    let package = folder.path().join("rivet.deb");
    let (root, control) = (folder.path().join("root"), folder.path().join("control"));
    succeed(Command::new("dpkg-deb").arg("--extract").arg(&package).arg(&root));
    succeed(Command::new("dpkg-deb").arg("--control").arg(&package).arg(&control));

    // The files of `cargo xtask install`, and Debian's own.
    let installed = folder.path().join("installed");
    succeed(Command::new(xtask).args(["install", "--prefix", "/usr", "--destdir"]).arg(&installed));
    let packed: Vec<String> = files(&root, &root).iter().map(|name| name.trim_end_matches(".gz").to_owned()).collect();
    let (same, further): (Vec<String>, Vec<String>) =
        packed.into_iter().partition(|name| installed.join(name).symlink_metadata().is_ok());
    assert_eq!(same, files(&installed, &installed));
    let own = |name: &String| !name.starts_with("usr/share/doc/rivet/") && !name.starts_with("etc/needrestart/");
    assert_eq!(further.iter().filter(|name| own(name)).collect::<Vec<_>>(), Vec::<&String>::new());

    // The licence texts of the crates, those that only one program has included.
    let licences =
        std::fs::read_to_string(installed.join("usr/share/doc/rivet/third-party-licences.txt")).expect("it is there");
    for wanted in ["\nrustdds ", "\ntungstenite ", "\niceoryx2 ", "Permission is hereby granted", "Apache License"] {
        assert!(licences.contains(wanted), "{wanted:?}");
    }
    for page in ["rivet-ros2.1", "rivet-view.1"] {
        assert!(same.iter().any(|name| name == &format!("usr/share/man/man1/{page}")), "{page}: {same:?}");
    }

    // Programs run, the library is found under its soname, a C program compiles and starts.
    for program in ["rivet", "rivetd", "rivet-controller", "rivet-sim", "rivet-ros2", "rivet-view"] {
        let version = succeed(Command::new(root.join("usr/bin").join(program)).arg("--version"));
        assert!(version.contains(env!("CARGO_PKG_VERSION")), "{version}");
    }
    if runs("cc", &["--version"]) && runs("pkg-config", &["--version"]) {
        let mut flags = Command::new("pkg-config");
        flags.env("PKG_CONFIG_SYSROOT_DIR", &root).env("PKG_CONFIG_LIBDIR", root.join("usr/lib/pkgconfig"));
        let flags = succeed(flags.args(["--cflags", "--libs", "librivet"]));
        let (source, program) = (root.join("usr/share/doc/rivet/examples/robot.c"), folder.path().join("robot"));
        succeed(Command::new("cc").arg(source).arg("-o").arg(&program).args(flags.split_whitespace()).arg("-lm"));
        let bus = rivet_ipc_schema::PrivateBus::new("package");
        let mut robot = Command::new(&program);
        robot.env("LD_LIBRARY_PATH", root.join("usr/lib")).arg("10").arg(&bus.config().prefix).arg(&bus.config().root);
        let printed = succeed(&mut robot);
        assert!(printed.starts_with("published 10, lost 0, "), "{printed}");
    } else {
        skipped("cc or pkg-config does not run: no program is compiled with the package's headers");
    }

    // Installing enables, starts and restarts nothing.
    for script in ["postinst", "prerm", "postrm"] {
        let text = std::fs::read_to_string(control.join(script)).expect(script);
        let is_command = |line: &&str| !line.trim_start().starts_with('#') && !line.trim_start().starts_with("echo ");
        let commands: String = text.lines().filter(is_command).collect();
        for word in ["systemctl enable", "systemctl start", "systemctl restart", "systemctl try-restart", "deb-systemd"]
        {
            assert!(!commands.contains(word), "{script}: {word}");
        }
        assert!(script == "prerm" || !commands.contains("systemctl stop"), "{script}");
    }
    let fields = std::fs::read_to_string(control.join("control")).expect("control");
    for line in ["Package: rivet", "Maintainer: rivet developers <maintainers@rivet.invalid>"] {
        assert!(fields.lines().any(|field| field == line), "{fields}");
    }
    let depends = fields.lines().find(|line| line.starts_with("Depends: ")).expect("it depends on something");
    assert!(depends.contains("libc6 (") && depends.contains("systemd-standalone-sysusers"), "{depends}");
}
