//! Which files of a crate import which, and the circles among them.
//!
//! A file imports another if a path in it leads to an item of the other; names that a file only passes on (`use`) lead to
//! where they are defined. What a file uses of those above it in the tree (`super`, the crate's root) is no edge: a module
//! and its submodules are one thing to a reader. Tests are left out.

use std::collections::{BTreeMap, BTreeSet};

/// The place of a file in its crate; the root is empty.
pub(crate) type Module = Vec<String>;

/// What a file says of others.
#[derive(Debug, Default)]
struct Source {
    /// Names brought in, with their paths.
    names: BTreeMap<String, Vec<String>>,
    /// Paths used.
    paths: Vec<Vec<String>>,
}

/// Returns the groups of files that import each other, in order.
pub(crate) fn circles(files: &BTreeMap<Module, String>) -> Vec<BTreeSet<Module>> {
    let sources: BTreeMap<&Module, Source> = files.iter().map(|(module, text)| (module, Source::read(text))).collect();
    let reached: BTreeMap<&Module, BTreeSet<Module>> =
        sources.keys().map(|module| (*module, reach(&sources, module))).collect();
    let together = |a: &Module, b: &Module| reached[a].contains(b) && reached[b].contains(a);
    let mut found: Vec<BTreeSet<Module>> = Vec::new();
    for module in files.keys().filter(|module| reached[*module].contains(*module)) {
        if found.iter().all(|circle| !circle.contains(module)) {
            found.push(files.keys().filter(|other| together(module, other)).cloned().collect());
        }
    }
    found
}

/// Returns all files that a file imports, directly or through others.
fn reach(sources: &BTreeMap<&Module, Source>, from: &Module) -> BTreeSet<Module> {
    let (mut reached, mut open) = (BTreeSet::new(), vec![from.clone()]);
    while let Some(module) = open.pop() {
        for path in &sources[&module].paths {
            let target = target(sources, module.clone(), path, 0).filter(|to| !module.starts_with(to));
            if let Some(target) = target.filter(|target| reached.insert(target.clone())) {
                open.push(target);
            }
        }
    }
    reached
}

/// Returns the file of this crate that a path leads to.
fn target(sources: &BTreeMap<&Module, Source>, at: Module, path: &[String], depth: usize) -> Option<Module> {
    let Some((first, rest)) = path.split_first() else { return Some(at) };
    let below: Module = at.iter().cloned().chain([first.clone()]).collect();
    match first.as_str() {
        "crate" => target(sources, Module::new(), rest, depth),
        "self" => target(sources, at, rest, depth),
        "super" => target(sources, at[..at.len().checked_sub(1)?].to_vec(), rest, depth),
        _ if sources.contains_key(&below) => target(sources, below, rest, depth),
        _ => match sources[&at].names.get(first) {
            Some(path) if depth < 8 => {
                let own = ["crate", "self", "super"].contains(&path[0].as_str());
                let below: Module = at.iter().cloned().chain([path[0].clone()]).collect();
                let whole: Vec<String> = path.iter().chain(rest).cloned().collect();
                if own || sources.contains_key(&below) { target(sources, at, &whole, depth + 1) } else { None }
            }
            Some(_) => None,
            None => Some(at),
        },
    }
}

impl Source {
    fn read(text: &str) -> Self {
        let text = code(text);
        let (mut source, mut rest) = (Self::default(), text.as_str());
        let mut body = String::new();
        while let Some((before, after)) = rest.split_once("use ") {
            body.push_str(before);
            let begins = before.is_empty() || before.ends_with(['\n', ' ', ')', '{']);
            let Some((tree, after)) = after.split_once(';').filter(|_| begins) else {
                rest = after;
                continue;
            };
            for (name, path) in leaves(&[], tree) {
                source.paths.push(path.clone());
                source.names.insert(name, path);
            }
            rest = after;
        }
        body.push_str(rest);
        for word in body.split(|c: char| !(c.is_alphanumeric() || c == '_' || c == ':')) {
            let path: Vec<String> = word.split("::").map(str::to_owned).collect();
            let rooted = path[0].starts_with(|c: char| c.is_lowercase());
            if path.len() > 1 && rooted && path.iter().all(|part| !part.is_empty()) {
                source.paths.push(path);
            }
        }
        // A path is looked up only where it begins with a word that leads into this crate.
        let Self { names, paths } = &mut source;
        paths.retain(|path| ["crate", "self", "super"].contains(&path[0].as_str()) || path.len() > 1);
        names.retain(|name, path| path.len() > 1 || *name != path[0]);
        source
    }
}

/// Returns a source without comments, texts and its tests.
fn code(text: &str) -> String {
    let text = text.split("#[cfg(test)]\nmod tests").next().unwrap_or(text);
    let mut kept = String::new();
    for line in text.lines() {
        let line = line.split("//").next().unwrap_or_default();
        for (index, part) in line.split('"').enumerate() {
            kept.push_str(if index % 2 == 0 { part } else { " " });
        }
        kept.push('\n');
    }
    kept
}

/// Returns the names that a tree of `use` brings in, with their paths.
fn leaves(before: &[String], tree: &str) -> Vec<(String, Vec<String>)> {
    let tree = tree.trim();
    let (path, inner) = match tree.split_once('{') {
        Some((path, inner)) => (path, inner.trim_end().strip_suffix('}')),
        None => (tree, None),
    };
    let (path, renamed) = path.split_once(" as ").map_or((path, None), |(path, name)| (path, Some(name.trim())));
    let own = path.split("::").map(str::trim).filter(|part| !part.is_empty() && *part != "*").map(str::to_owned);
    let mut whole: Vec<String> = before.iter().cloned().chain(own).collect();
    let Some(inner) = inner else {
        if whole.len() > 1 && whole.last().is_some_and(|last| last == "self") {
            whole.pop();
        }
        let name = renamed.map(str::to_owned).or_else(|| whole.last().cloned());
        return name.map(|name| (name, whole)).into_iter().collect();
    };
    let (mut depth, mut from, mut found) = (0, 0, Vec::new());
    for (index, c) in inner.char_indices() {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                found.extend(leaves(&whole, &inner[from..index]));
                from = index + 1;
            }
            _ => {}
        }
    }
    if !inner[from..].trim().is_empty() {
        found.extend(leaves(&whole, &inner[from..]));
    }
    found
}

#[test]
fn circles_are_found_through_names_that_are_passed_on() {
    let file = |module: &str, text: &str| {
        let module = module.split('/').filter(|part| !part.is_empty()).map(str::to_owned).collect();
        (module, text.to_owned())
    };
    let files = BTreeMap::from([
        file("", "mod a;\nmod b;\npub use b::Thing;"),
        file("a", "use crate::{Thing};\npub(crate) fn made() {}"),
        file("b", "pub struct Thing;\nfn f() { crate::a::made() }"),
        file("b/below", "use super::Thing;\nuse crate::c::{self, other};"),
        file("c", "// use crate::b::below::x;\nfn other() -> &str { \"crate::b::below::x\" }"),
    ]);
    let found = circles(&files);
    let names: Vec<Vec<String>> = found.iter().map(|circle| circle.iter().map(|m| m.join("/")).collect()).collect();
    assert_eq!(names, [["a", "b"]]);
}
