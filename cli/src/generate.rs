//! Completions of the shells and man pages, from the definitions of the commands.

use anyhow::{Context as _, Result};
use clap_complete::Shell;
use rivet_analysis::fault::Fault;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Shells whose completions are written, each with its folder below `share`.
const SHELLS: [(Shell, &str); 3] = [
    (Shell::Bash, "bash-completion/completions"),
    (Shell::Zsh, "zsh/site-functions"),
    (Shell::Fish, "fish/vendor_completions.d"),
];

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Folder to write to, laid out as /usr/share: man/man1, and a folder for each shell
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

/// Writes a man page for every command and the completions for every shell.
pub(crate) fn run(args: &Args, command: clap::Command) -> Result<ExitCode> {
    let manual = made(&args.folder.join("man/man1"))?;
    let mut pages = 0;
    let mut command = command;
    command.build();
    write_pages(&command, &manual, &mut pages)?;
    let name = command.get_name().to_owned();
    for (shell, folder) in SHELLS {
        let folder = made(&args.folder.join(folder))?;
        let mut script = Vec::new();
        clap_complete::generate(shell, &mut command, &name, &mut script);
        let path = folder.join(clap_complete::Generator::file_name(&shell, &name));
        rivet_files::write_whole(&path, script).with_context(|| path.display().to_string())?;
    }
    crate::table::show(&format!(
        "{pages} man pages, completions for bash, zsh and fish in {}\n",
        args.folder.display()
    ))?;
    Ok(ExitCode::SUCCESS)
}

fn made(folder: &Path) -> Result<PathBuf> {
    if let Some(file) = folder.ancestors().find(|above| above.is_file()) {
        return Err(Fault::Usage(format!("{}: is a file; give a folder", file.display())).into());
    }
    fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    Ok(folder.to_owned())
}

/// One page for a command and one for each command below it: `rivet.1`, `rivet-study-real.1`.
fn write_pages(command: &clap::Command, folder: &Path, pages: &mut usize) -> Result<()> {
    let page = clap_mangen::Man::new(command.clone());
    let path = folder.join(page.get_filename());
    let mut text = Vec::new();
    page.render(&mut text)?;
    rivet_files::write_whole(&path, text).with_context(|| path.display().to_string())?;
    *pages += 1;
    for below in command.get_subcommands().filter(|below| !below.is_hide_set() && below.get_name() != "help") {
        write_pages(below, folder, pages)?;
    }
    Ok(())
}
