//! The rules of the house as tests: layers, who may name which library, names, sizes, heads of files.
//!
//! A new crate, a new edge upwards or a new namer of a library fails here until the table below says so.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

#[path = "harness.rs"]
mod harness;
use harness::workspace;

/// Every package and its layer; imports point to a lower layer only.
const LAYERS: &[(&str, u32)] = &[
    ("ds-space", 0),
    ("ds-page", 0),
    ("ds-world", 1),
    ("ds-raster", 1),
    ("ds-effect", 1),
    ("ds-stats", 1),
    ("ds-nn", 1),
    ("ds-topic", 2),
    ("ds-scenario", 2),
    ("ds-sim", 2),
    ("ds-camera", 2),
    ("ds-second-camera", 2),
    ("ds-layout", 2),
    ("ds-score", 2),
    ("ds-fidelity", 2),
    ("ds-graph", 2),
    ("ds-diagnosis", 2),
    ("ds-kernel", 2),
    ("ds-import", 3),
    ("ds-episode", 3),
    ("ds-dynamics", 3),
    ("ds-score-cases", 3),
    ("ds-oracle", 3),
    ("ds-backend", 3),
    ("ds-policy", 3),
    ("ds-diagnosis-page", 4),
    ("ds-vehicle-logs", 4),
    ("ds-frames", 4),
    ("ds-traffic", 4),
    ("ds-wire", 4),
    ("ds-video", 4),
    ("ds-clips", 5),
    ("ds-perception", 5),
    ("ds-bus", 5),
    ("ds-run-report", 5),
    ("ds-record", 5),
    ("ds-process", 6),
    ("ds-cases", 6),
    ("ds-train", 6),
    ("ds-evaluate", 7),
    ("orchestrator", 7),
    ("sim-server", 7),
    ("layout-render", 7),
    ("vdm-worker", 7),
    ("policy-bridge", 7),
    ("dreamstream", 8),
];

/// Outside libraries that only the named packages may depend on.
const NAMED_ONLY_BY: &[(&str, &[&str])] = &[
    ("zenoh", &["ds-bus"]),
    ("prost", &["ds-wire"]),
    ("prost-types", &["ds-wire"]),
    ("tonic", &["ds-wire", "orchestrator", "ds-process", "dreamstream"]),
    ("wgpu", &["ds-layout"]),
    ("naga", &["ds-layout"]),
    ("burn", &["ds-graph"]),
    ("gemm", &["ds-kernel"]),
    ("pulp", &["ds-kernel"]),
    ("rapier3d", &["ds-sim"]),
    ("mcap", &["ds-record"]),
    ("rerun", &["ds-record"]),
    ("glam", &["ds-space"]),
    ("redb", &["orchestrator"]),
    ("rusqlite", &["ds-import"]),
    ("rand", &[]),
];

const FORBIDDEN_NAMES: &[&str] = &["utils", "util", "common", "shared", "core", "helpers", "misc", "types", "manager"];
const MAX_FILE_LINES: usize = 500;

struct Package {
    name: String,
    folder: PathBuf,
    dependencies: BTreeSet<String>,
}

fn packages() -> Vec<Package> {
    let mut found = Vec::new();
    let groups = fs::read_dir(workspace().join("crates")).expect("the workspace has crates");
    let groups = groups.map(|entry| entry.expect("readable entry").path()).filter(|path| path.is_dir());
    for group in groups.chain([workspace().join("services")]) {
        let entries = fs::read_dir(group).expect("a readable group");
        found.extend(entries.map(|entry| entry.expect("readable entry").path()));
    }
    found.sort();
    found.iter().filter(|folder| folder.join("Cargo.toml").exists()).map(|folder| package(folder)).collect()
}

fn package(folder: &Path) -> Package {
    let text = fs::read_to_string(folder.join("Cargo.toml")).expect("readable manifest");
    let manifest: toml::Table = text.parse().expect("manifest is TOML");
    let name = manifest["package"]["name"].as_str().expect("package has a name").to_owned();
    let mut dependencies = BTreeSet::new();
    for section in ["dependencies", "dev-dependencies", "build-dependencies"] {
        if let Some(table) = manifest.get(section).and_then(toml::Value::as_table) {
            dependencies.extend(table.keys().cloned());
        }
    }
    Package { name, folder: folder.to_path_buf(), dependencies }
}

fn sources(folder: &Path, out: &mut Vec<PathBuf>) {
    let mut entries: Vec<PathBuf> =
        fs::read_dir(folder).expect("readable folder").map(|entry| entry.expect("readable entry").path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() && !path.ends_with("generated") && !path.ends_with("target") {
            sources(&path, out);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            out.push(path);
        }
    }
}

#[test]
fn imports_point_to_a_lower_layer() {
    let layers: BTreeMap<&str, u32> = LAYERS.iter().copied().collect();
    let mut faults = Vec::new();
    for package in packages() {
        let Some(layer) = layers.get(package.name.as_str()) else {
            faults.push(format!("{} has no layer", package.name));
            continue;
        };
        for dependency in &package.dependencies {
            if layers.get(dependency.as_str()).is_some_and(|other| other >= layer) {
                faults.push(format!("{} imports {dependency}, which is not below it", package.name));
            }
        }
    }
    assert!(faults.is_empty(), "{faults:#?}");
}

#[test]
fn libraries_are_named_by_their_owners_only() {
    let mut faults = Vec::new();
    for package in packages() {
        for (library, owners) in NAMED_ONLY_BY {
            if package.dependencies.contains(*library) && !owners.contains(&package.name.as_str()) {
                faults.push(format!("{} names {library}, which belongs to {owners:?}", package.name));
            }
        }
    }
    assert!(faults.is_empty(), "{faults:#?}");
}

#[test]
fn files_have_a_head_a_noun_and_a_bounded_size() {
    let mut faults = Vec::new();
    for package in packages() {
        let mut files = Vec::new();
        sources(&package.folder, &mut files);
        for file in files {
            let text = fs::read_to_string(&file).expect("readable source");
            let name = file.strip_prefix(workspace()).unwrap_or(&file).display().to_string();
            if !text.starts_with("//!") {
                faults.push(format!("{name} does not open with //!"));
            }
            let stem = file.file_stem().and_then(|stem| stem.to_str()).unwrap_or_default();
            if FORBIDDEN_NAMES.contains(&stem) || stem == "mod" {
                faults.push(format!("{name} has a forbidden name"));
            }
            let code = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or(&text);
            let lines = code.lines().count();
            if lines > MAX_FILE_LINES {
                faults.push(format!("{name} has {lines} lines, the limit is {MAX_FILE_LINES}"));
            }
        }
    }
    assert!(faults.is_empty(), "{faults:#?}");
}

/// Folders of the workspace that hold what was made, not written.
const MADE: &[&str] = &["target", "out", "training", "node_modules"];

fn documents(folder: &Path, out: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("readable folder") {
        let path = entry.expect("readable entry").path();
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        if path.is_dir() && !name.starts_with('.') && !MADE.contains(&name) {
            documents(&path, out);
        } else if name.ends_with(".md") {
            out.push(path);
        }
    }
}

/// Returns the text outside of blocks of code.
fn prose(text: &str) -> String {
    text.split("\n```").step_by(2).collect()
}

/// Returns the anchors of the headings of a document.
fn anchors(text: &str) -> BTreeSet<String> {
    let kept = |letter: char| letter.is_alphanumeric() || "-_ ".contains(letter);
    let headings = text.lines().filter(|line| line.starts_with('#')).map(|line| line.trim_start_matches('#').trim());
    headings
        .map(|heading| heading.to_lowercase().chars().filter(|c| kept(*c)).collect::<String>().replace(' ', "-"))
        .collect()
}

#[test]
fn links_and_paths_of_documents_lead_somewhere() {
    let (mut files, mut faults) = (Vec::new(), Vec::new());
    documents(&workspace(), &mut files);
    for file in files {
        let text = prose(&fs::read_to_string(&file).expect("readable document"));
        let mut lost = |what: &str| faults.push(format!("{}: {what}", file.display()));
        for link in text.split("](").skip(1).filter_map(|rest| Some(rest.split_once(')')?.0)) {
            let (path, anchor) = link.split_once('#').unwrap_or((link, ""));
            let target = if path.is_empty() { file.clone() } else { file.with_file_name(path) };
            let known = || prose(&fs::read_to_string(&target).unwrap_or_default());
            if !link.starts_with("http")
                && (!target.exists() || !anchor.is_empty() && !anchors(&known()).contains(anchor))
            {
                lost(link);
            }
        }
        // What was is named in the changelog; capitals, stars and dots stand for any name.
        let paths = text.split('`').skip(1).step_by(2).filter(|_| !file.ends_with("CHANGELOG.md"));
        for path in paths.filter(|path| !path.contains(['*', '<', '…', ' ', '{']) && !path.contains("NAME")) {
            let top = path.split_once('/').map_or("", |(top, _)| top);
            if ["crates", "services", "tests", "configs", "docs", "clients", "proto"].contains(&top)
                && !workspace().join(path).exists()
            {
                lost(path);
            }
        }
    }
    assert!(faults.is_empty(), "{faults:#?}");
}

#[test]
fn every_crate_has_a_sentence_for_newcomers() {
    let text = fs::read_to_string(workspace().join("crates/README.md")).expect("readable document");
    let crates = packages().into_iter().filter_map(|package| package.name.strip_prefix("ds-").map(str::to_owned));
    let missing: Vec<String> = crates.filter(|name| !text.contains(&format!("\n| `{name}` | "))).collect();
    assert!(missing.is_empty(), "crates/README.md says nothing of {missing:?}");
}
