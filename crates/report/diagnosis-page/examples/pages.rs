//! Writes the pages of diagnosed cases: `cargo run -p ds-diagnosis-page --example pages -- CASES_DIR DIAGNOSES_DIR`.
//!
//! Reads `DIAGNOSES_DIR/<case>/diagnosis.json`, writes `page.html` and `page.txt` beside each and `index.html` above.

use std::path::PathBuf;

use ds_diagnosis::Diagnosis;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1).map(PathBuf::from);
    let (cases, out) = arguments.next().zip(arguments.next()).ok_or("which cases, and where are their diagnoses?")?;
    let mut folders: Vec<PathBuf> = std::fs::read_dir(&out)?.filter_map(|e| e.ok().map(|e| e.path())).collect();
    folders.sort();
    let mut listed = Vec::new();
    for folder in folders {
        let Ok(json) = std::fs::read_to_string(folder.join("diagnosis.json")) else { continue };
        let diagnosis: Diagnosis = serde_json::from_str(&json)?;
        let name = folder.file_name().unwrap_or_default();
        std::fs::write(folder.join("page.html"), ds_diagnosis_page::page(&diagnosis, Some(&cases.join(name))))?;
        std::fs::write(folder.join("page.txt"), ds_diagnosis_page::text(&diagnosis))?;
        listed.push((format!("{}/page.html", name.to_string_lossy()), diagnosis));
    }
    std::fs::write(out.join("index.html"), ds_diagnosis_page::index(&listed))?;
    Ok(())
}
