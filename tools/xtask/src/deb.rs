//! `cargo xtask deb`: a Debian package of what `cargo xtask install --prefix /usr` puts into a folder.

use crate::install::{PROGRAMS, SHARED_LIBRARY, build, install, workspace};
use crate::sbom;
use anyhow::{Context as _, Result, ensure};
use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Folder of the package's files; `assets` of [package.metadata.deb] in cli/Cargo.toml names it too.
const TREE: &str = "target/package/tree";
/// Changelog in Debian's form; `changelog` of [package.metadata.deb] names it too.
const CHANGELOG: &str = "target/package/changelog";
/// File of the folder `debian` that is no script, and where the package has it.
const NEEDRESTART: (&str, &str) = ("needrestart.conf", "etc/needrestart/conf.d/rivet.conf");
/// Suffix of the package's version: the first package of this version of the programs.
const REVISION: &str = "1";

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Who answers for the package: `Name <address>`
    #[arg(long, default_value = "rivet developers <maintainers@rivet.invalid>")]
    maintainer: String,
    /// Folder of the package [default: target/debian]
    #[arg(long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Compresses less: a larger package in less time
    #[arg(long)]
    fast: bool,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let source = workspace()?;
    ensure!(is_installed(), "cargo-deb is not installed: cargo install cargo-deb --locked");
    let tree = source.join(TREE);
    if tree.exists() {
        fs::remove_dir_all(&tree).with_context(|| tree.display().to_string())?;
    }
    let target = build(source)?;
    install(source, &target, &tree, Path::new("/usr"))?;
    strip(&tree)?;
    let (from, to) =
        (Path::new(env!("CARGO_MANIFEST_DIR")).join("debian").join(NEEDRESTART.0), tree.join(NEEDRESTART.1));
    fs::create_dir_all(to.parent().context("a place has a folder")?).with_context(|| to.display().to_string())?;
    fs::copy(&from, &to).with_context(|| from.display().to_string())?;
    set_mode(&to, 0o644)?;
    if sbom::is_installed() {
        sbom::write(source, &tree.join("usr/share/doc/rivet/sbom"))?;
    } else {
        println!(
            "without bills of materials: cargo-cyclonedx is not installed (cargo install cargo-cyclonedx --locked)"
        );
    }
    fs::write(source.join(CHANGELOG), changelog(source, &args.maintainer)?).context(CHANGELOG)?;
    let mut deb = Command::new(env!("CARGO"));
    // Quiet: it warns that it builds nothing of the tree, as it shall.
    deb.current_dir(source).args(["deb", "--no-build", "--locked", "--quiet", "--package", "rivet"]);
    deb.args(["--maintainer", &args.maintainer, "--deb-revision", REVISION]);
    if let Some(output) = &args.output {
        deb.arg("--output").arg(std::path::absolute(output)?);
    }
    if args.fast {
        deb.arg("--fast");
    }
    ensure!(deb.status().context("cargo deb cannot be started")?.success(), "cargo deb made no package");
    Ok(())
}

fn is_installed() -> bool {
    let mut version = Command::new(env!("CARGO"));
    version.args(["deb", "--version"]).stdout(Stdio::null()).stderr(Stdio::null());
    version.status().is_ok_and(|status| status.success())
}

/// Takes symbols that nothing links to out of programs and libraries, as Debian's packages are without them.
fn strip(tree: &Path) -> Result<()> {
    let (bin, lib) = (tree.join("usr/bin"), tree.join("usr/lib"));
    let programs = PROGRAMS.map(|(program, ..)| (bin.join(program), "--strip-all", 0o755));
    let libraries =
        [(lib.join(SHARED_LIBRARY), "--strip-unneeded", 0o644), (lib.join("librivet.a"), "--strip-debug", 0o644)];
    for (path, symbols, mode) in programs.into_iter().chain(libraries) {
        let mut strip = Command::new("strip");
        strip.args([symbols, "--remove-section=.comment", "--remove-section=.note"]).arg(&path);
        ensure!(strip.status().context("strip (binutils) cannot be started")?.success(), "{}", path.display());
        set_mode(&path, mode)?;
    }
    Ok(())
}

fn set_mode(path: &Path, mode: u32) -> Result<()> {
    fs::set_permissions(path, fs::Permissions::from_mode(mode)).with_context(|| path.display().to_string())
}

/// Debian's changelog: this version, at the time of SOURCE_DATE_EPOCH, else of the last commit, else of now.
fn changelog(source: &Path, maintainer: &str) -> Result<String> {
    let line = |command: &mut Command| {
        let answer = command.current_dir(source).stderr(Stdio::null()).output().ok()?;
        let line = String::from_utf8_lossy(&answer.stdout).trim().to_owned();
        (answer.status.success() && !line.is_empty()).then_some(line)
    };
    let seconds = std::env::var("SOURCE_DATE_EPOCH").ok();
    let seconds = seconds.or_else(|| line(Command::new("git").args(["log", "-1", "--format=%ct"])));
    let when = seconds.map_or_else(|| "now".to_owned(), |seconds| format!("@{seconds}"));
    let date =
        line(Command::new("date").args(["--utc", "--rfc-email", "--date", &when])).context("date does not run")?;
    let version = env!("CARGO_PKG_VERSION");
    Ok(format!(
        "rivet ({version}-{REVISION}) unstable; urgency=medium\n\n  * Version {version}: /usr/share/doc/rivet/changelog.gz \
         lists what changed.\n\n -- {maintainer}  {date}\n"
    ))
}
