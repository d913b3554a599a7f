//! Where a command writes: asked before what takes long, and never over what it reads or twice into one file.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use rivet_config::Robot;

use rivet_analysis::fault::Fault;

/// What a command reads and what it writes.
pub(crate) struct Outputs<'a> {
    inputs: Vec<&'a Path>,
    files: Vec<(&'a str, &'a Path)>,
    folder: Option<&'a Path>,
}

impl<'a> Outputs<'a> {
    /// Of a command that reads `robot` from `file`, its description and `logs`.
    pub(crate) fn for_logs(robot: &'a Robot, file: &'a Path, logs: impl IntoIterator<Item = &'a PathBuf>) -> Self {
        let config = &robot.config;
        let mut inputs = vec![file, config.urdf.as_path()];
        inputs.extend(config.friction.load_urdf.as_deref());
        inputs.extend(logs.into_iter().map(PathBuf::as_path));
        Outputs::given(inputs)
    }

    /// Of a command that reads `inputs`.
    pub(crate) fn given(inputs: Vec<&'a Path>) -> Self {
        Outputs { inputs, files: Vec::new(), folder: None }
    }

    /// The file that `option` asks for.
    pub(crate) fn file(mut self, option: &'a str, path: Option<&'a PathBuf>) -> Self {
        self.files.extend(path.map(|path| (option, path.as_path())));
        self
    }

    /// The folder of `--export`, which gets a model and what belongs to it.
    pub(crate) fn export(mut self, folder: Option<&'a PathBuf>) -> Self {
        self.folder = folder.map(PathBuf::as_path);
        self
    }

    /// That all of it can be written.
    pub(crate) fn check(&self) -> Result<()> {
        for (option, path) in &self.files {
            if path.as_os_str() == "-" {
                let why = format!(
                    "{option} -: takes a file; standard output is {option} /dev/stdout, a file of this name {option} ./-"
                );
                return Err(Fault::Usage(why).into());
            }
            rivet_files::writable(path).with_context(|| path.display().to_string())?;
        }
        if let Some(folder) = self.folder {
            rivet_files::writable_folder(folder).with_context(|| folder.display().to_string())?;
        }
        self.apart()
    }

    fn apart(&self) -> Result<()> {
        let mut written: Vec<(&str, PathBuf)> = Vec::new();
        for (option, path) in &self.files {
            let Some(place) = place(path) else { continue };
            if let Some(input) = self.inputs.iter().find(|input| is_at(input, &place)) {
                return Err(refused(option, path, &format!("would replace {}, which is read", input.display())));
            }
            if let Some((other, _)) = written.iter().find(|(_, there)| *there == place) {
                return Err(refused(option, path, &format!("is what {other} writes as well")));
            }
            written.push((option, place));
        }
        let Some(folder) = self.folder else { return Ok(()) };
        let Some(there) = folder.canonicalize().ok() else { return Ok(()) };
        let into = |path: &PathBuf| path.parent() == Some(&there) && path.file_name().is_some_and(is_exported);
        let input = self.inputs.iter().find(|input| place(input).is_some_and(|place| into(&place)));
        if let Some(input) = input {
            return Err(refused("--export", folder, &format!("would replace {}, which is read", input.display())));
        }
        match written.iter().find(|(_, place)| into(place)) {
            Some((option, _)) => {
                Err(refused("--export", folder, &format!("has a file of the name that {option} writes")))
            }
            None => Ok(()),
        }
    }
}

/// Writes the value into the file of `--json`, where one was asked for.
///
/// # Errors
/// The file cannot be written.
pub(crate) fn write_json(path: Option<&PathBuf>, value: &impl serde::Serialize) -> Result<()> {
    let Some(path) = path else { return Ok(()) };
    let text = rivet_files::printable_json(serde_json::to_string_pretty(value)? + "\n");
    rivet_files::write_whole(path, &text).with_context(|| path.display().to_string())
}

fn refused(option: &str, path: &Path, why: &str) -> anyhow::Error {
    Fault::Usage(format!("{option} {} {why}; name another place", path.display())).into()
}

/// Names in the folder of `--export`.
fn is_exported(name: &std::ffi::OsStr) -> bool {
    let name = name.to_string_lossy();
    ["model.toml", "robot.urdf", "robot.xml", "load.urdf", "not-expressible.md"].contains(&name.as_ref())
        || name.starts_with("separating-")
}

/// The name that bytes for `path` take, whether it is there or not; none for folders, pipes and devices. A link is replaced, and what it
/// points to stays.
fn place(path: &Path) -> Option<PathBuf> {
    if std::fs::metadata(path).is_ok_and(|there| !there.is_file()) {
        return None;
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    Some(folder.canonicalize().ok()?.join(path.file_name()?))
}

/// Whether what takes the place `written` would replace an input: the file, or a link that leads to it.
fn is_at(input: &Path, written: &Path) -> bool {
    place(input).is_some_and(|input| input == written) || input.canonicalize().is_ok_and(|input| input == written)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outputs<'a>(inputs: &[&'a Path], files: &[(&'a str, &'a Path)], folder: Option<&'a Path>) -> Outputs<'a> {
        Outputs { inputs: inputs.to_vec(), files: files.to_vec(), folder }
    }

    #[test]
    fn a_dash_is_no_file() {
        let why = outputs(&[], &[("--json", Path::new("-"))], None).check().expect_err("refused").to_string();
        assert!(why.contains("--json /dev/stdout"), "{why}");
    }

    #[test]
    fn nothing_is_written_over_what_is_read_or_twice() {
        let folder = tempfile::tempdir().expect("a folder");
        let at = |name: &str| folder.path().join(name);
        let (log, urdf, link) = (at("log.csv"), at("robot.urdf"), at("link.csv"));
        for file in [&log, &urdf] {
            std::fs::write(file, "text").expect("written");
        }
        std::os::unix::fs::symlink("log.csv", &link).expect("a link");
        let (new, odd) = (at("new.json"), folder.path().join(".").join("new.json"));
        let no = |inputs: &[&Path], files: &[(&str, &Path)], folder: Option<&Path>| {
            outputs(inputs, files, folder).check().expect_err("refused").to_string()
        };
        assert!(no(&[&log], &[("--json", &log)], None).contains("which is read"));
        assert!(no(&[&link], &[("--json", &log)], None).contains("which is read"), "through a link");
        assert!(no(&[&link], &[("--json", &link)], None).contains("which is read"), "the link itself");
        assert!(no(&[&log], &[("--json", &new), ("--html", &odd)], None).contains("--json writes as well"));
        assert!(no(&[&urdf], &[], Some(folder.path())).contains("which is read"));
        let model = at("model.toml");
        assert!(no(&[&log], &[("--json", &model)], Some(folder.path())).contains("--json writes"));
        outputs(&[&log], &[("--json", &new)], Some(folder.path())).check().expect("a log beside an export stays");
        // A link is replaced: neither what is read nor another output is where it points to.
        let other = at("other.csv");
        std::os::unix::fs::symlink("log.csv", &other).expect("a link");
        outputs(&[&log], &[("--json", &link), ("--html", &other)], None).check().expect("links are names of their own");
        let null = Path::new("/dev/null");
        outputs(&[&log], &[("--json", null), ("--html", null)], None).check().expect("no file");
        assert_eq!(std::fs::read_to_string(&log).expect("there"), "text");
    }
}
