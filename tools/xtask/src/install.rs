//! `cargo xtask install`: programs, library, units, user, directories, robots, headers.

use crate::licences;
use anyhow::{Context as _, Result, ensure};
use rivet_files::Draft;
use std::fs;
use std::io::Write as _;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Programs of the workspace that are installed, the package and the profile that each is built from.
pub(crate) const PROGRAMS: [(&str, &str, &str); 6] = [
    ("rivet", "rivet", "release"),
    ("rivetd", "rivet-daemon", "service"),
    ("rivet-controller", "rivet-controller", "service"),
    ("rivet-sim", "rivet-simulation", "release"),
    ("rivet-ros2", "rivet-ros2", "release"),
    ("rivet-view", "rivet-view", "release"),
];
/// The package of the library for robot controllers. It is built with the profile `release`: it catches panics.
pub(crate) const LIBRARY: &str = "librivet";
/// The shared library's file: its soname.
pub(crate) const SHARED_LIBRARY: &str = "librivet.so.1";
/// What a program that links the static library needs beside it (`rustc --print native-static-libs`).
const STATIC_NEEDS: &str = "-lgcc_s -lutil -lrt -lpthread -lm -ldl -lc";
/// Folder beside the programs with what is made for the installation, laid out as `share`: man pages, completions, licences.
const GENERATED: &str = "generated";
/// Where the units in the source say that the programs and their documents are.
const UNIT_PREFIXES: [&str; 2] = ["/usr/bin/", "/usr/share/"];

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Where the programs will run from; units, sysusers.d and tmpfiles.d go to its lib folder.
    #[arg(long, default_value = "/usr/local")]
    prefix: PathBuf,
    /// Puts everything below this folder instead of the root: a package's, or a container's.
    #[arg(long, value_name = "DIR", default_value = "/")]
    destdir: PathBuf,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    ensure!(args.prefix.is_absolute(), "--prefix {}: it must be absolute", args.prefix.display());
    let source = workspace()?;
    let target = build(source)?;
    let installed = install(source, &target, &args.destdir, &args.prefix)?;
    println!("{installed} files below {}", below(&args.destdir, &args.prefix).display());
    if args.destdir == Path::new("/") {
        println!("next, as root: ldconfig && systemd-sysusers && systemd-tmpfiles --create && systemctl daemon-reload");
    }
    println!("then a robot:  /etc/rivet/<robot>/robot.toml, and systemctl enable --now rivetd@<robot>");
    Ok(())
}

/// Root of the checkout.
pub(crate) fn workspace() -> Result<&'static Path> {
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).context("xtask lies in the workspace")
}

/// Builds the programs; returns the folder that has one for each profile.
pub(crate) fn build(source: &Path) -> Result<PathBuf> {
    for profile in ["release", "service"] {
        let mut cargo = Command::new(env!("CARGO"));
        cargo.current_dir(source).args(["build", "--locked", "--profile", profile]);
        for (_, package, _) in PROGRAMS.iter().filter(|(_, _, its)| *its == profile) {
            cargo.args(["--package", package]);
        }
        if profile == "release" {
            cargo.args(["--package", LIBRARY]);
        }
        ensure!(cargo.status().context("cargo cannot be started")?.success(), "the programs do not build");
    }
    // This program was built beside them.
    let this = std::env::current_exe().context("this program cannot find itself")?;
    let target = this.ancestors().nth(2).context("a program lies in its profile's folder")?.to_owned();
    let mut generate = Command::new(target.join("release/rivet"));
    generate.arg("generate").arg(target.join(GENERATED));
    ensure!(generate.status().context("rivet cannot be started")?.success(), "rivet writes no man pages");
    put(&target.join(GENERATED).join("doc/rivet").join(licences::FILE), licences::text(source)?.as_bytes(), 0o644)?;
    Ok(target)
}

/// `path` as it is called before the root is put in front.
fn below(destdir: &Path, path: &Path) -> PathBuf {
    destdir.join(path.strip_prefix("/").unwrap_or(path))
}

/// Puts everything below `destdir`; returns how many files. `target` has a folder of programs for each profile.
pub(crate) fn install(source: &Path, target: &Path, destdir: &Path, prefix: &Path) -> Result<usize> {
    let to = |inner: &str| below(destdir, &prefix.join(inner));
    let mut files = 0;
    for (program, _, profile) in PROGRAMS {
        let path = target.join(profile).join(program);
        let bytes = fs::read(&path).with_context(|| format!("{}: not built?", path.display()))?;
        files += put(&to("bin").join(program), &bytes, 0o755)?;
    }
    files += install_library(&target.join("release"), &to("lib"), prefix)?;
    let here = ["bin", "share"].map(|inner| format!("{}/", prefix.join(inner).display()));
    for (folder, inner) in
        [("system", "lib/systemd/system"), ("sysusers.d", "lib/sysusers.d"), ("tmpfiles.d", "lib/tmpfiles.d")]
    {
        for path in listed(&source.join("systemd").join(folder))? {
            let text = fs::read_to_string(&path).with_context(|| path.display().to_string())?;
            let text = UNIT_PREFIXES.iter().zip(&here).fold(text, |text, (from, to)| text.replace(from, to));
            let name = path.file_name().context("a listed file has a name")?;
            files += put(&to(inner).join(name), text.as_bytes(), 0o644)?;
        }
    }
    for (file, inner) in [
        ("ipc-schema/include/rivet.h", "include/rivet.h"),
        ("librivet/include/librivet.h", "include/librivet.h"),
        ("librivet/include/librivet.hpp", "include/librivet.hpp"),
        ("ipc-schema/python/rivet_ipc.py", "share/rivet/rivet_ipc.py"),
        ("librivet/python/librivet.py", "share/rivet/librivet.py"),
        ("crates/view/layouts/rivet.json", "share/rivet/layouts/rivet.json"),
        ("README.md", "share/doc/rivet/README.md"),
        ("CHANGELOG.md", "share/doc/rivet/changelog"),
        ("LICENSE-MIT", "share/doc/rivet/LICENSE-MIT"),
        ("LICENSE-APACHE", "share/doc/rivet/LICENSE-APACHE"),
    ] {
        let path = source.join(file);
        let bytes = fs::read(&path).with_context(|| path.display().to_string())?;
        files += put(&to(inner), &bytes, 0o644)?;
    }
    for robot in listed(&source.join("robots"))?.iter().filter(|path| path.is_dir()) {
        let name = robot.file_name().context("a listed folder has a name")?;
        for path in listed(robot)?.iter().filter(|path| path.is_file()) {
            let bytes = fs::read(path).with_context(|| path.display().to_string())?;
            let file = path.file_name().context("a listed file has a name")?;
            files += put(&to("share/rivet/robots").join(name).join(file), &bytes, 0o644)?;
        }
    }
    files += put_all(&source.join("docs"), &to("share/doc/rivet"))?;
    files += put_all(&source.join("examples"), &to("share/doc/rivet/examples"))?;
    files += put_all(&target.join(GENERATED), &to("share"))?;
    // `rivet daemon` is the same program under another name.
    Ok(files + put(&to("share/man/man1/rivetd.1"), b".so man1/rivet-daemon.1\n", 0o644)?)
}

/// Shared and static library, the name that a linker looks for, and the file of pkg-config; `built` has the libraries.
fn install_library(built: &Path, lib: &Path, prefix: &Path) -> Result<usize> {
    let mut files = 0;
    for (from, to, mode) in [("librivet.so", SHARED_LIBRARY, 0o755), ("librivet.a", "librivet.a", 0o644)] {
        let path = built.join(from);
        let bytes = fs::read(&path).with_context(|| format!("{}: not built?", path.display()))?;
        files += put(&lib.join(to), &bytes, mode)?;
    }
    let link = lib.join("librivet.so");
    if fs::symlink_metadata(&link).is_ok() {
        fs::remove_file(&link).with_context(|| link.display().to_string())?;
    }
    symlink(SHARED_LIBRARY, &link).with_context(|| link.display().to_string())?;
    let text = format!(
        "prefix={}\nlibdir=${{prefix}}/lib\nincludedir=${{prefix}}/include\n\nName: librivet\n\
         Description: connects a robot controller to rivet\nVersion: {}\nCflags: -I${{includedir}}\n\
         Libs: -L${{libdir}} -lrivet\nLibs.private: {STATIC_NEEDS}\n",
        prefix.display(),
        env!("CARGO_PKG_VERSION")
    );
    Ok(files + 1 + put(&lib.join("pkgconfig/librivet.pc"), text.as_bytes(), 0o644)?)
}

/// Puts every file below a folder at the same place below another, without what Python has compiled.
fn put_all(from: &Path, to: &Path) -> Result<usize> {
    let mut files = 0;
    for path in listed(from)?.iter().filter(|path| !path.ends_with("__pycache__")) {
        let place = to.join(path.file_name().context("a listed file has a name")?);
        if path.is_dir() {
            files += put_all(path, &place)?;
        } else {
            let bytes = fs::read(path).with_context(|| path.display().to_string())?;
            files += put(&place, &bytes, 0o644)?;
        }
    }
    Ok(files)
}

/// What lies in a folder, in the order of names.
pub(crate) fn listed(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    let mut paths = entries.map(|entry| Ok(entry?.path())).collect::<Result<Vec<_>>>()?;
    paths.sort();
    Ok(paths)
}

/// Writes a file beside its place and renames it: a program that is running keeps the file that it runs from.
fn put(path: &Path, bytes: &[u8], mode: u32) -> Result<usize> {
    let write = || -> std::io::Result<()> {
        fs::create_dir_all(path.parent().unwrap_or(path))?;
        let mut draft = Draft::new(path)?.with_mode(mode);
        draft.file().write_all(bytes)?;
        draft.publish().map(drop)
    };
    write().with_context(|| path.display().to_string())?;
    Ok(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt as _;

    #[test]
    fn everything_is_put_where_the_units_say() {
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).expect("the workspace");
        let (programs, destdir) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
        for (program, _, profile) in PROGRAMS {
            fs::create_dir_all(programs.path().join(profile)).expect("made");
            fs::write(programs.path().join(profile).join(program), profile).expect("written");
        }
        for library in ["librivet.so", "librivet.a"] {
            fs::write(programs.path().join("release").join(library), library).expect("written");
        }
        let manual = programs.path().join(GENERATED).join("man/man1");
        fs::create_dir_all(&manual).expect("made");
        fs::write(manual.join("rivet.1"), "page").expect("written");
        // Twice: over itself it installs as well.
        for _ in 0..2 {
            install(source, programs.path(), destdir.path(), Path::new("/opt/rivet")).expect("installed");
        }
        assert_eq!(fs::read(destdir.path().join("opt/rivet/share/man/man1/rivet.1")).expect("installed"), b"page");
        // What runs for months is what unwinds nothing.
        let daemon = fs::read_to_string(destdir.path().join("opt/rivet/bin/rivetd")).expect("installed");
        assert_eq!(daemon, "service");
        let unit = destdir.path().join("opt/rivet/lib/systemd/system/rivetd@.service");
        let unit = fs::read_to_string(unit).expect("the unit is there");
        let command = unit.lines().find_map(|line| line.strip_prefix("ExecStart=")).expect("it starts something");
        let program = command.split_whitespace().next().expect("a word");
        assert_eq!(program, "/opt/rivet/bin/rivetd");
        let documents = unit.lines().find_map(|line| line.strip_prefix("Documentation=file://")).expect("it has some");
        assert!(documents.starts_with("/opt/rivet/"), "{documents}");
        assert!(below(destdir.path(), Path::new(documents)).is_file(), "{documents}");
        assert!(!unit.contains("/usr/"), "{unit}");
        let mode = fs::metadata(below(destdir.path(), Path::new(program))).expect("it is there").permissions().mode();
        assert_eq!(mode & 0o777, 0o755);
        assert!(destdir.path().join("opt/rivet/lib/sysusers.d/rivet.conf").is_file());
        let lib = destdir.path().join("opt/rivet/lib");
        assert_eq!(fs::read_link(lib.join("librivet.so")).expect("a link"), Path::new(SHARED_LIBRARY));
        assert_eq!(fs::read(lib.join(SHARED_LIBRARY)).expect("installed"), b"librivet.so");
        for header in ["rivet.h", "librivet.h", "librivet.hpp"] {
            assert!(destdir.path().join("opt/rivet/include").join(header).is_file(), "{header}");
        }
        assert!(destdir.path().join("opt/rivet/share/rivet/librivet.py").is_file());
        assert!(destdir.path().join("opt/rivet/share/rivet/robots/dd2/robot.toml").is_file());
    }

    /// What `pkg-config` makes of the installed file.
    #[test]
    fn pkg_config_finds_headers_and_library() {
        let (built, lib) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
        for library in ["librivet.so", "librivet.a"] {
            fs::write(built.path().join(library), library).expect("written");
        }
        install_library(built.path(), lib.path(), Path::new("/opt/rivet")).expect("installed");
        let mut asked = Command::new("pkg-config");
        asked.env("PKG_CONFIG_PATH", lib.path().join("pkgconfig")).args(["--cflags", "--libs", "librivet"]);
        let Ok(answer) = asked.output() else {
            let _ = writeln!(std::io::stderr(), "SKIPPED: pkg-config does not run");
            return;
        };
        let words = String::from_utf8_lossy(&answer.stdout);
        assert_eq!(
            words.split_whitespace().collect::<Vec<_>>(),
            ["-I/opt/rivet/include", "-L/opt/rivet/lib", "-lrivet"]
        );
    }
}
