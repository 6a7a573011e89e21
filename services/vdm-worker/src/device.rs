//! Which accelerators a worker sees. The orchestrator hands each out once; a worker without any computes on the processor.

use std::path::Path;

/// Lists the accelerators of this host as `host/nvidia0`, in order.
#[must_use]
pub fn detected() -> Vec<String> {
    listed(Path::new("/dev"), &host())
}

fn listed(folder: &Path, host: &str) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let names = entries.filter_map(|entry| entry.file_name().into_string().ok());
    let number = |name: &str| name.strip_prefix("nvidia")?.parse::<u32>().ok();
    let mut numbers: Vec<u32> = names.filter_map(|name| number(&name)).collect();
    numbers.sort_unstable();
    numbers.iter().map(|number| format!("{host}/nvidia{number}")).collect()
}

/// Returns the host's name, so that equal devices of two hosts are told apart.
fn host() -> String {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let name = name.trim();
    if name.is_empty() { "host".to_owned() } else { name.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn accelerators_are_listed_by_number() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        for name in ["nvidia10", "nvidia2", "nvidiactl", "nvidia-uvm", "null"] {
            std::fs::write(folder.path().join(name), "").expect("is written");
        }
        assert_eq!(listed(folder.path(), "a"), ["a/nvidia2", "a/nvidia10"]);
        assert!(listed(&folder.path().join("none"), "a").is_empty());
    }
}
