//! Generates the Rust code and the descriptor set from `proto/` and compares them with the committed files.
//!
//! `UPDATE_GENERATED=1 cargo test -p ds-wire --test all generated` writes them instead. The compiler is pure Rust.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use protox::prost::Message;

fn folder(relative: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(relative)
}

/// Every `.proto` file below a folder, relative to it, sorted.
fn sources(root: &Path, below: &Path, found: &mut Vec<PathBuf>) {
    let mut entries: Vec<PathBuf> =
        std::fs::read_dir(below).expect("proto folder").map(|entry| entry.expect("readable entry").path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            sources(root, &path, found);
        } else if path.extension().is_some_and(|extension| extension == "proto") {
            found.push(path.strip_prefix(root).expect("lies below the root").to_path_buf());
        }
    }
}

fn generate() -> BTreeMap<String, Vec<u8>> {
    let root = folder("../../../proto");
    let mut files = Vec::new();
    sources(&root, &root, &mut files);
    let mut compiler = protox::Compiler::new([&root]).expect("proto folder");
    compiler.include_imports(true).include_source_info(true);
    compiler.open_files(&files).unwrap_or_else(|error| panic!("{error:?}"));
    let out = tempfile::tempdir().expect("temporary folder");
    let set = compiler.file_descriptor_set();
    tonic_prost_build::configure()
        .out_dir(out.path())
        .emit_rerun_if_changed(false)
        .bytes(".")
        .btree_map(".")
        .compile_fds(set.clone())
        .expect("code is generated");
    let mut made = BTreeMap::new();
    for entry in std::fs::read_dir(out.path()).expect("output folder") {
        let path = entry.expect("readable entry").path();
        let name = path.file_name().expect("file name").to_string_lossy().into_owned();
        made.insert(name, std::fs::read(path).expect("generated file"));
    }
    // Comments stay in the sources; a recording or a reflection client needs names and numbers only.
    let mut bare = set;
    for file in &mut bare.file {
        file.source_code_info = None;
    }
    made.insert("dreamstream.binpb".to_owned(), bare.encode_to_vec());
    made
}

#[test]
fn committed_code_is_what_the_protos_say() {
    let committed = folder("src/generated");
    for (name, content) in generate() {
        let path = committed.join(&name);
        if std::env::var_os("UPDATE_GENERATED").is_some() {
            std::fs::write(&path, &content).expect("committed file is writable");
        }
        let found = std::fs::read(&path).unwrap_or_default();
        assert!(found == content, "{name} differs from the protos; run with UPDATE_GENERATED=1 and commit the result");
    }
}
