//! Gives every stage the hash of its own source: of the files of its room (a folder or file right
//! below `src/`) and of the rooms that these use, found by following `crate::room`. Tests and
//! comments are left out, and so are all other rooms: a change of the search redoes no trial.

use std::collections::BTreeSet;
use std::collections::btree_map::{BTreeMap, Entry};
use std::path::{Path, PathBuf};
use std::{env, fs};

/// The stages' rooms, and in which environment variables the program finds their hashes. The page
/// shows what `compare` finds, which draws by the report.
const STAGES: [(&str, &str); 3] = [
    ("ingest", "TRILINK_INGEST_SOURCE"),
    ("fit", "TRILINK_FIT_SOURCE"),
    ("compare", "TRILINK_REPORT_SOURCE"),
];

fn main() {
    for changed in ["src", "Cargo.lock", "build.rs"] {
        println!("cargo:rerun-if-changed={changed}");
    }
    let home = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").expect("cargo says where"));
    for (room, variable) in STAGES {
        println!("cargo:rustc-env={variable}={}", source_hash(&home, room));
    }
}

/// Hash of a room, of all rooms that it uses and of the versions of all crates.
pub fn source_hash(home: &Path, room: &str) -> String {
    let mut hash = Hash::new();
    for (name, text) in closure(&home.join("src"), room).into_values().flat_map(|room| room.files) {
        hash.add(&name);
        hash.add(&text);
    }
    hash.add(&lines(&fs::read_to_string(home.join("Cargo.lock")).unwrap_or_default()));
    format!("{:032x}", hash.0)
}

/// A room and all that it uses, by name.
pub fn closure(src: &Path, room: &str) -> BTreeMap<String, Room> {
    let mut found = BTreeMap::new();
    let mut open = vec![room.to_owned()];
    while let Some(name) = open.pop() {
        let path = [format!("{name}.rs"), format!("{name}/mod.rs")].map(|file| src.join(file));
        let Some(path) = path.into_iter().find(|path| path.is_file()) else { continue };
        if let Entry::Vacant(entry) = found.entry(name) {
            let mut room = Room::default();
            room.read(src, &path, 1);
            open.extend(room.uses.iter().cloned());
            entry.insert(room);
        }
    }
    found
}

/// A folder or file right below `src/`.
#[derive(Default)]
pub struct Room {
    /// Source and what it includes, by path from `src/`.
    files: BTreeMap<String, String>,
    /// Names below `crate::`.
    uses: BTreeSet<String>,
}

impl Room {
    /// Reads a module, its children and what they include. `depth` is 1 right below the crate.
    fn read(&mut self, src: &Path, path: &Path, depth: usize) {
        let text = without_tests(&fs::read_to_string(path).unwrap_or_default());
        let folder = path.parent().unwrap_or(src);
        let own = match path.file_name().is_some_and(|name| name == "mod.rs") {
            true => folder.to_owned(),
            false => path.with_extension(""),
        };
        for line in text.lines() {
            let declared = line.trim_start_matches("pub").trim_start_matches("(crate)").trim();
            if let Some(child) = declared.strip_prefix("mod ").and_then(|l| l.strip_suffix(';')) {
                let child = [format!("{child}.rs"), format!("{child}/mod.rs")];
                if let Some(child) = child.iter().map(|c| own.join(c)).find(|c| c.is_file()) {
                    self.read(src, &child, depth + 1);
                }
            }
        }
        for include in ["include_str!(\"", "include_bytes!(\""] {
            for name in text.split(include).skip(1).filter_map(|rest| rest.split('"').next()) {
                let bytes = fs::read(folder.join(name)).unwrap_or_default();
                self.add(src, &folder.join(name), lines(&String::from_utf8_lossy(&bytes)));
            }
        }
        // Whoever is two folders deep reaches the crate with two `super::`, too.
        let root = "super::".repeat(depth);
        let above = |rest: &str| rest.split(&root).skip(1).map(str::to_owned).collect::<Vec<_>>();
        for rest in text.split("crate::").skip(1).map(str::to_owned).chain(above(&text)) {
            let end = if rest.starts_with('{') { rest.find('}').unwrap_or(0) } else { 0 };
            let names = match end {
                0 => &rest[..rest.find(|c| !is_letter(c)).unwrap_or(rest.len())],
                end => &rest[1..end],
            };
            self.uses.extend(names.split(|c| !is_letter(c)).map(str::to_owned));
        }
        self.add(src, path, text);
    }

    fn add(&mut self, src: &Path, path: &Path, text: String) {
        let name = path.strip_prefix(src).unwrap_or(path).to_string_lossy().replace('\\', "/");
        self.files.insert(name, text);
    }
}

fn is_letter(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// The text with the same ends of lines everywhere.
fn lines(text: &str) -> String {
    text.lines().map(|line| line.to_owned() + "\n").collect()
}

/// Source without lines of comments and without items that are compiled for tests alone.
fn without_tests(text: &str) -> String {
    let mut kept = String::new();
    let mut lines = text.lines().filter(|line| !line.trim_start().starts_with("//"));
    while let Some(line) = lines.next() {
        if line.trim() != "#[cfg(test)]" {
            kept += line;
            kept += "\n";
            continue;
        }
        // As it is formatted, an item ends with its first line or where a line closes it.
        let indent = &line[..line.len() - line.trim_start().len()];
        let first = lines.by_ref().find(|line| !line.trim_start().starts_with("#[")).unwrap_or("");
        if !first.ends_with([';', '}']) {
            let ends = |line: &&str| *line == format!("{indent}}}") || line.ends_with(';');
            let closing = |line: &&str| match first.ends_with('{') {
                true => **line == format!("{indent}}}"),
                false => ends(line),
            };
            lines.by_ref().find(|line| closing(line));
        }
    }
    kept
}

/// Fowler, Noll and Vo's hash (FNV-1a) of 128 bits: the same wherever the program is built.
struct Hash(u128);

impl Hash {
    fn new() -> Self {
        Self(0x6c62_272e_07bb_0142_62b8_2175_6295_c58d)
    }

    fn add(&mut self, text: &str) {
        // What no text has stands between two of them.
        for byte in text.bytes().chain([0xff]) {
            self.0 = (self.0 ^ u128::from(byte)).wrapping_mul(0x0100_0000_0000_0000_0000_013b);
        }
    }
}
