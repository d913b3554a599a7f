//! Paths of meshes and textures in a robot description that is written into another folder.

use std::path::{Component, Path, PathBuf};

/// The description with each relative `filename` that leads to a file from `from` leading to the same file from `to`. Addresses with a
/// scheme (`package://`) and absolute paths stay, as do paths that lead nowhere.
pub(crate) fn moved(text: &str, from: &Path, to: &Path) -> String {
    let (Ok(from), Ok(to)) = (folder(from).canonicalize(), folder(to).canonicalize()) else { return text.to_owned() };
    let (mut out, mut rest) = (String::with_capacity(text.len()), text);
    while let Some(at) = rest.find("filename") {
        let (before, after) = rest.split_at(at + "filename".len());
        out += before;
        rest = after;
        let value = after.trim_start().strip_prefix('=').map(str::trim_start);
        let Some(value) = value.filter(|value| value.starts_with(['"', '\''])) else { continue };
        let (quote, value) = value.split_at(1);
        let Some((path, following)) = value.split_once(quote) else { continue };
        let path = seen_from(&to, &from, path).unwrap_or_else(|| path.to_owned());
        for part in ["=", quote, &path, quote] {
            out += part;
        }
        rest = following;
    }
    out + rest
}

fn folder(path: &Path) -> &Path {
    if path.as_os_str().is_empty() { Path::new(".") } else { path }
}

/// The relative `path` from `from`, as it is from `to`; none where it stays.
fn seen_from(to: &Path, from: &Path, path: &str) -> Option<String> {
    if path.contains("://") || Path::new(path).is_absolute() {
        return None;
    }
    let file = from.join(path).canonicalize().ok()?;
    let common = file.components().zip(to.components()).take_while(|(a, b)| a == b).count();
    let up = to.components().skip(common).map(|_| Component::ParentDir);
    let relative: PathBuf = up.chain(file.components().skip(common)).collect();
    relative.to_str().map(str::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_lead_to_the_same_files() {
        let root = tempfile::tempdir().expect("a folder");
        let [from, to] = ["robots/arm", "out/patched"].map(|name| root.path().join(name));
        for folder in [&from.join("meshes"), &to] {
            std::fs::create_dir_all(folder).expect("a folder");
        }
        std::fs::write(from.join("meshes/link.stl"), "mesh").expect("a file");
        let text = "<mesh filename=\"meshes/link.stl\"/><mesh filename = 'meshes/link.stl' scale=\"1 1 1\"/>\
                    <mesh filename=\"package://arm/link.stl\"/><mesh filename=\"meshes/missing.stl\"/> filename";
        let moved = moved(text, &from, &to);
        let path = "../../robots/arm/meshes/link.stl";
        assert_eq!(std::fs::read_to_string(to.join(path)).expect("the same file"), "mesh");
        let expected = format!(
            "<mesh filename=\"{path}\"/><mesh filename='{path}' scale=\"1 1 1\"/>\
             <mesh filename=\"package://arm/link.stl\"/><mesh filename=\"meshes/missing.stl\"/> filename"
        );
        assert_eq!(moved, expected);
        assert_eq!(super::moved(text, &from, &from), text.replace("filename = '", "filename='"));
    }
}
