//! Computes a source hash for each stage of the pipeline (ingest, fit, report). The hash covers the sources and assets
//! of the stage's crate and of the workspace crates on which it depends, the features that these crates request from
//! external crates, and the checksums of the external crates. A change to the report code therefore makes no fit stale,
//! and a change to the solver makes no trial stale.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::{env, fs};

use toml::Table;

/// Crate of each stage, and the environment variable that holds the stage's source hash.
const STAGES: [(&str, &str); 3] = [
    ("trilink-ingest", "TRILINK_INGEST_SOURCE"),
    ("trilink-fit", "TRILINK_FIT_SOURCE"),
    ("trilink-report", "TRILINK_REPORT_SOURCE"),
];

fn main() {
    for changed in ["crates", "src/compare", "Cargo.lock", "Cargo.toml", "build.rs"] {
        println!("cargo:rerun-if-changed={changed}");
    }
    let home =
        PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").expect("cargo sets CARGO_MANIFEST_DIR"));
    let lock = fs::read_to_string(home.join("Cargo.lock")).expect("Cargo.lock");
    let lock = Packages::new(&lock);
    for (package, variable) in STAGES {
        let mut hash = lock.source_hash(&home, package);
        // The report page shows the comparison with the baseline.
        if package == "trilink-report" {
            hash.add_files(&home.join("src/compare"));
        }
        println!("cargo:rustc-env={variable}={:032x}", hash.0);
    }
}

/// Packages in `Cargo.lock`, indexed by name, each with all locked versions.
pub struct Packages(BTreeMap<String, Vec<Table>>);

impl Packages {
    pub fn new(lock: &str) -> Self {
        let lock: Table = lock.parse().expect("Cargo.lock is TOML");
        let mut packages: BTreeMap<String, Vec<Table>> = BTreeMap::new();
        for package in lock["package"].as_array().into_iter().flatten() {
            let package = package.as_table().expect("a package is a table");
            let name = package["name"].as_str().expect("a name").to_owned();
            packages.entry(name).or_default().push(package.clone());
        }
        Self(packages)
    }

    /// Hashes a package together with its direct and indirect dependencies.
    pub fn source_hash(&self, home: &Path, package: &str) -> Hash {
        let mut hash = Hash::new();
        let workspace = manifest(home);
        let workspace = workspace.get("workspace").and_then(|table| table.get("dependencies"));
        for name in self.closure(home, package) {
            for found in self.0.get(&name).into_iter().flatten() {
                hash.add(&name);
                for key in ["version", "checksum"] {
                    hash.add(found.get(key).and_then(|text| text.as_str()).unwrap_or_default());
                }
            }
            let entry = workspace.and_then(|table| table.get(&name));
            hash.add(entry.map(ToString::to_string).unwrap_or_default());
            if let Some(folder) = folder(home, &name) {
                let manifest = manifest(&folder);
                for key in ["dependencies", "features"] {
                    hash.add(manifest.get(key).map(ToString::to_string).unwrap_or_default());
                }
                hash.add_files(&folder.join("src"));
                hash.add_files(&folder.join("assets"));
            }
        }
        hash
    }

    /// Returns the sorted names of a package and of its direct and indirect dependencies.
    pub fn closure(&self, home: &Path, package: &str) -> Vec<String> {
        let mut found = Vec::new();
        let mut open = vec![package.to_owned()];
        while let Some(name) = open.pop() {
            if !found.contains(&name) {
                open.extend(self.dependencies(home, &name));
                found.push(name);
            }
        }
        found.sort();
        found
    }

    /// Returns the names of a package's direct dependencies. Those of a workspace member are read from its manifest,
    /// because `Cargo.lock` also lists dev-dependencies.
    fn dependencies(&self, home: &Path, name: &str) -> Vec<String> {
        if let Some(folder) = folder(home, name) {
            let manifest = manifest(&folder);
            let dependencies = manifest.get("dependencies").and_then(|table| table.as_table());
            return dependencies.into_iter().flatten().map(|(name, _)| name.clone()).collect();
        }
        let packages = self.0.get(name).into_iter().flatten();
        let listed = packages.filter_map(|package| package.get("dependencies")?.as_array());
        let names = listed.flatten().filter_map(|listed| listed.as_str()?.split(' ').next());
        names.map(str::to_owned).collect()
    }
}

/// Reads the `Cargo.toml` of a folder.
fn manifest(folder: &Path) -> Table {
    let text = fs::read_to_string(folder.join("Cargo.toml")).expect("a manifest");
    text.parse().expect("a manifest is TOML")
}

/// Returns the source folder of a workspace package, or `None` for a package from a registry (which has a checksum).
fn folder(home: &Path, package: &str) -> Option<PathBuf> {
    let folder = home.join("crates").join(package.strip_prefix("trilink-")?);
    folder.join("Cargo.toml").is_file().then_some(folder)
}

/// 128-bit Fowler-Noll-Vo hash (FNV-1a), independent of the build platform.
pub struct Hash(pub u128);

impl Hash {
    fn new() -> Self {
        Self(0x6c62_272e_07bb_0142_62b8_2175_6295_c58d)
    }

    fn add(&mut self, entry: impl AsRef<[u8]>) {
        // 0xff never occurs in UTF-8, so it separates entries.
        for byte in entry.as_ref().iter().chain(&[0xff]) {
            self.0 = (self.0 ^ u128::from(*byte)).wrapping_mul(0x0100_0000_0000_0000_0000_013b);
        }
    }

    /// Adds the names and contents of all files below a folder, except tests, to the hash; line endings do not affect
    /// it.
    fn add_files(&mut self, folder: &Path) {
        let entries = fs::read_dir(folder).into_iter().flatten().flatten();
        let mut paths: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
        paths.sort();
        for path in paths {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            match &*name {
                "tests" | "tests.rs" => {}
                _ if path.is_dir() => self.add_files(&path),
                name => {
                    self.add(name);
                    let bytes = fs::read(&path).unwrap_or_default();
                    match std::str::from_utf8(&bytes) {
                        Ok(text) => text.lines().for_each(|line| self.add(line)),
                        Err(_) => self.add(&bytes),
                    }
                }
            }
        }
    }
}
