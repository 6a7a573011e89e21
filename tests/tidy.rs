//! The rules of the house as tests: layers, who may name which library, names, sizes, heads of files.
//!
//! A new crate, a new edge upwards or a new namer of a library fails here until the table below says so.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

#[path = "tidy/circles.rs"]
mod circles;

const FORBIDDEN_NAMES: &[&str] = &["utils", "util", "common", "shared", "core", "helpers", "misc", "types", "manager"];
const MAX_FILE_LINES: usize = 500;

/// Files of one crate that still import each other in a circle.
const CIRCLES: &[&str] = &[];

/// Returns the root of the workspace.
fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

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

/// Returns every package and its layer as the code map of ARCHITECTURE.md has them.
fn layers(packages: &[Package]) -> BTreeMap<String, u32> {
    let text = fs::read_to_string(workspace().join("ARCHITECTURE.md")).expect("the architecture is written down");
    let mut layers = BTreeMap::new();
    for line in
        text.lines().skip_while(|line| !line.starts_with("| layer |")).skip(2).take_while(|l| l.starts_with('|'))
    {
        let mut cells = line.trim_matches('|').split('|').map(str::trim);
        let (Some(layer), Some(names)) = (cells.next(), cells.next()) else { panic!("the line {line:?} is no row") };
        let layer = layer.parse().unwrap_or_else(|_| panic!("{layer:?} is no layer"));
        for name in names.split(',').map(|name| name.trim().trim_matches('`')) {
            if let Some(group) = name.strip_suffix("/*") {
                let members = packages.iter().filter(|package| package.folder.starts_with(workspace().join(group)));
                members.for_each(|member| _ = layers.entry(member.name.clone()).or_insert(layer));
            } else {
                let crated = format!("ds-{name}");
                let known = packages.iter().any(|package| package.name == crated);
                layers.insert(if known { crated } else { name.to_owned() }, layer);
            }
        }
    }
    layers
}

#[test]
fn imports_point_to_a_lower_layer() {
    let packages = packages();
    let layers = layers(&packages);
    let mut faults = Vec::new();
    for name in layers.keys().filter(|name| packages.iter().all(|package| package.name != **name)) {
        faults.push(format!("{name} has a layer and is no package"));
    }
    for package in &packages {
        let Some(layer) = layers.get(&package.name) else {
            faults.push(format!("{} has no layer", package.name));
            continue;
        };
        for dependency in &package.dependencies {
            if layers.get(dependency).is_some_and(|other| other >= layer) {
                faults.push(format!("{} imports {dependency}, which is not below it", package.name));
            }
        }
    }
    assert!(faults.is_empty(), "{faults:#?}");
}

#[test]
fn every_source_file_is_a_module_of_its_crate() {
    let mut left = Vec::new();
    for src in packages().into_iter().map(|package| package.folder.join("src")) {
        let mut files = Vec::new();
        sources(&src, &mut files);
        for path in files.iter().filter(|path| !path.ends_with("lib.rs") && !path.ends_with("main.rs")) {
            let (folder, stem) = (path.parent().expect("a folder"), path.file_stem().and_then(|stem| stem.to_str()));
            let parents = [folder.join("lib.rs"), folder.join("main.rs"), folder.with_extension("rs")];
            let named = format!("mod {};", stem.expect("a plain name"));
            let names = |parent: &PathBuf| fs::read_to_string(parent).is_ok_and(|text| text.contains(&named));
            if !parents.iter().any(names) {
                left.push(path.clone());
            }
        }
    }
    assert!(left.is_empty(), "nobody builds {left:#?}");
}

#[test]
fn every_file_of_tests_is_in_a_program() {
    let folders: Vec<PathBuf> = packages().into_iter().map(|package| package.folder).chain([workspace()]).collect();
    let read = |path: PathBuf| fs::read_to_string(path).unwrap_or_default();
    let said: String = folders.iter().map(|f| read(f.join("Cargo.toml")) + &read(f.join("tests/all.rs"))).collect();
    let mut left = Vec::new();
    for tests in folders.iter().map(|folder| folder.join("tests")).filter(|tests| tests.join("all.rs").exists()) {
        let all = read(tests.join("all.rs"));
        for path in fs::read_dir(&tests).expect("a readable folder").map(|entry| entry.expect("an entry").path()) {
            let name = path.file_name().and_then(|name| name.to_str()).expect("a plain name").to_owned();
            let Some(module) = name.strip_suffix(".rs").filter(|module| *module != "all") else { continue };
            if !all.contains(&format!("mod {module};")) && !said.contains(&format!("tests/{name}\"")) {
                left.push(path);
            }
        }
    }
    assert!(left.is_empty(), "nobody builds {left:#?}");
}

/// Returns deny.toml.
fn rules() -> toml::Table {
    let text = fs::read_to_string(workspace().join("deny.toml")).expect("readable deny.toml");
    text.parse().expect("deny.toml is TOML")
}

/// Returns a list of names.
fn names(value: &toml::Value) -> BTreeSet<String> {
    value.as_array().into_iter().flatten().filter_map(|name| Some(name.as_str()?.to_owned())).collect()
}

#[test]
fn libraries_are_named_by_their_owners_only() {
    let (packages, mut faults, mut owned) = (packages(), Vec::new(), 0);
    for rule in rules()["bans"]["deny"].as_array().expect("bans.deny is a list") {
        let Some(owners) = rule.get("wrappers").map(names) else { continue };
        let library = rule["crate"].as_str().expect("a rule names a crate");
        for package in packages.iter().filter(|package| package.dependencies.contains(library)) {
            owned += 1;
            if !owners.contains(&package.name) {
                faults.push(format!("{} names {library}, which belongs to {owners:?}", package.name));
            }
        }
    }
    assert!(faults.is_empty() && owned > 10, "{owned} owned edges, {faults:#?}");
}

#[test]
fn files_of_one_crate_import_each_other_without_circles() {
    let (mut faults, mut left): (Vec<String>, Vec<&str>) = (Vec::new(), CIRCLES.to_vec());
    for package in packages() {
        let root = package.folder.join("src");
        let mut files = Vec::new();
        sources(&root, &mut files);
        let mut texts: BTreeMap<circles::Module, String> = BTreeMap::new();
        for file in files {
            let place = file.strip_prefix(&root).expect("is below its root").with_extension("");
            let mut module: circles::Module = place.iter().map(|part| part.to_string_lossy().into_owned()).collect();
            if module.first().is_some_and(|first| first == "bin") || module.last().is_some_and(|last| last == "tests") {
                continue;
            }
            if module == ["lib"] || module == ["main"] {
                module.clear();
            }
            texts.entry(module).or_default().push_str(&fs::read_to_string(&file).expect("readable source"));
        }
        for circle in circles::circles(&texts) {
            let names: Vec<String> = circle.iter().map(|module| module.join("/")).collect();
            let name = format!("{}: {}", package.name, names.join(", "));
            match left.iter().position(|known| *known == name) {
                Some(index) => drop(left.swap_remove(index)),
                None => faults.push(name),
            }
        }
    }
    faults.extend(left.into_iter().map(|name| format!("{name}: a circle no more, take it off the list")));
    assert!(faults.is_empty(), "{faults:#?}");
}

/// Returns the packages that a build compiles with their features and licences, one a line.
fn built(arguments: &[&str], format: &str) -> BTreeSet<String> {
    let mut command = std::process::Command::new(env!("CARGO"));
    command.args(["tree", "--locked", "--offline", "--prefix", "none", "--format", format]);
    let said = command.args(arguments).current_dir(workspace()).output().expect("cargo tells the tree");
    assert!(said.status.success(), "{}", String::from_utf8_lossy(&said.stderr));
    String::from_utf8_lossy(&said.stdout).lines().map(|line| line.trim_end_matches(" (*)").to_owned()).collect()
}

/// Says whether a licence expression can be met with allowed licences.
fn is_met(expression: &str, allowed: &BTreeSet<String>) -> bool {
    let expression = expression.trim();
    let (mut depth, mut parts, mut from, mut bound) = (0, Vec::new(), 0, "");
    for (index, _) in expression.char_indices() {
        let rest = &expression[index..];
        depth += i32::from(rest.starts_with('(')) - i32::from(rest.starts_with(')'));
        let Some(word) = [" OR ", " AND ", "/"].into_iter().find(|word| depth == 0 && rest.starts_with(word)) else {
            continue;
        };
        // OR binds less than AND: the first OR outside brackets splits, else the ANDs do.
        if bound.is_empty() || (bound == " AND " && word != bound) {
            (parts, from, bound) = (Vec::new(), 0, word);
        }
        if (word == " AND ") == (bound == " AND ") {
            parts.push(&expression[from..index]);
            from = index + word.len();
        }
    }
    parts.push(&expression[from..]);
    match (bound, parts.as_slice()) {
        ("", [one]) => match one.strip_prefix('(').and_then(|inner| inner.strip_suffix(')')) {
            Some(inner) => is_met(inner, allowed),
            None => allowed.contains(*one),
        },
        (" AND ", parts) => parts.iter().all(|part| is_met(part, allowed)),
        (_, parts) => parts.iter().any(|part| is_met(part, allowed)),
    }
}

#[test]
fn licences_are_allowed_and_sources_known() {
    let allowed = names(&rules()["licenses"]["allow"]);
    for (expression, met) in
        [("MIT OR GPL-3.0", true), ("(MIT OR X) AND GPL-3.0", false), ("X AND Y OR MIT", true), ("MIT/X", true)]
    {
        assert_eq!(is_met(expression, &allowed), met, "{expression}");
    }
    let lines = built(&["--workspace", "--edges", "normal,build,dev"], "{p}|{l}");
    let refused =
        lines.iter().filter_map(|line| line.split_once('|')).filter(|(_, licence)| !is_met(licence, &allowed));
    let refused: Vec<_> = refused.collect();
    assert!(refused.is_empty() && lines.len() > 500, "{refused:#?}");
    let lock = fs::read_to_string(workspace().join("Cargo.lock")).expect("readable Cargo.lock");
    let known = "source = \"registry+https://github.com/rust-lang/crates.io-index\"";
    let foreign: Vec<&str> = lock.lines().filter(|line| line.starts_with("source = ") && *line != known).collect();
    assert!(foreign.is_empty(), "{foreign:#?}");
}

#[test]
fn one_build_serves_run_view_and_test() {
    let edges = ["--edges", "normal,build"];
    let all = built(&["--workspace", "--edges", "normal,build,dev"], "{p} {f}");
    for packages in [&["-p", "dreamstream"][..], &["-p", "dreamstream", "-p", "viewer"], &["-p", "trainer"]] {
        let again: Vec<String> = built(&[packages, &edges].concat(), "{p} {f}").difference(&all).cloned().collect();
        assert!(again.is_empty(), "`cargo test --workspace` builds these again with other features: {again:#?}");
    }
}

#[test]
fn no_program_of_tests_is_built_that_holds_none() {
    let mut faults = Vec::new();
    for package in packages() {
        let text = fs::read_to_string(package.folder.join("Cargo.toml")).expect("readable manifest");
        let manifest: toml::Table = text.parse().expect("manifest is TOML");
        let says = |target: Option<&toml::Value>, key: &str| {
            target.and_then(|target| target.get(key)).and_then(toml::Value::as_bool).unwrap_or(true)
        };
        let (src, library) = (package.folder.join("src"), manifest.get("lib"));
        let mut files = Vec::new();
        sources(&src, &mut files);
        let read = |file: &PathBuf| fs::read_to_string(file).expect("readable source");
        let holds =
            |word: &str| files.iter().any(|file| read(file).lines().any(|line| line.trim_start().starts_with(word)));
        let tests = ["#[test]", "#[tokio::test", "proptest! {"].into_iter().any(holds);
        let in_docs = ["//! ```", "/// ```"].into_iter().any(holds);
        if src.join("lib.rs").exists() {
            if says(library, "test") != tests {
                faults.push(format!("{}: `test` of its [lib] is not {tests}", package.name));
            }
            if says(library, "doctest") != in_docs {
                faults.push(format!("{}: `doctest` of its [lib] is not {in_docs}", package.name));
            }
        }
        let program = manifest.get("bin").and_then(toml::Value::as_array).and_then(|programs| programs.first());
        if src.join("main.rs").exists() && says(program, "test") {
            faults.push(format!("{}: a `main` holds no tests, say so by `test = false`", package.name));
        }
        if src.join("main.rs").exists() && !src.join("lib.rs").exists() && tests {
            faults.push(format!("{}: tests that no program holds", package.name));
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
        for path in paths.filter(|path| {
            !path.contains(['*', '<', '…', ' ', '{']) && !path.contains("NAME") && !path.contains("GROUP")
        }) {
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
