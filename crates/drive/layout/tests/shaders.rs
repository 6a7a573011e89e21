//! Every shader of the crate is parsed and validated without a device.

use naga::valid::{Capabilities, ValidationFlags, Validator};

#[test]
fn every_shader_is_valid() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/src");
    let mut found = 0;
    for entry in std::fs::read_dir(folder).expect("the crate has sources") {
        let path = entry.expect("the folder can be read").path();
        if path.extension().is_some_and(|extension| extension == "wgsl") {
            let text = std::fs::read_to_string(&path).expect("the shader can be read");
            let module = naga::front::wgsl::parse_str(&text).unwrap_or_else(|e| panic!("{}", e.emit_to_string(&text)));
            let mut validator = Validator::new(ValidationFlags::all(), Capabilities::empty());
            validator.validate(&module).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
            assert_eq!(module.entry_points.len(), 2, "{}", path.display());
            found += 1;
        }
    }
    assert_eq!(found, 1);
}
