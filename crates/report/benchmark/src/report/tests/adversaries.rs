//! Reports of made-up drives against adversaries: contacts and falls beside the base, severity, losses, and what was lost on the way.

use super::*;
use crate::Quality;
use crate::plot::Plot;
use crate::quality::Severity;

/// A base of six, a variant of each in two classes, and figures of the search: margins of 0.5 s, 1.5 s and so on.
fn adverse() -> ([Manifest; 2], Quality) {
    let base = manifest::tests::set(&SIX);
    let variant = |(index, entry): (usize, &crate::Entry)| crate::Entry {
        name: format!("{}__x", entry.name),
        base: Some(entry.name.clone()),
        category: if index < 4 { "rear-end" } else { "changing-lanes" }.to_owned(),
        ..manifest::tests::entry(&format!("{}__x", entry.name), "Apache-2.0")
    };
    let entries: Vec<_> = base.entries.iter().enumerate().map(variant).collect();
    let set = Manifest::new("hard", Kind::Behavior, crate::Recipe::default(), entries);
    let severity = |(index, entry): (usize, &crate::Entry)| {
        let closing_mps = 2.0 + 2.0 * index as f64;
        let margin_secs = Some(0.5 + index as f64);
        (
            entry.name.clone(),
            Severity { closing_mps, delta_v_mps: closing_mps / 2.0, margin_secs, ..Severity::default() },
        )
    };
    let variants = set.entries.iter().enumerate().map(severity).collect();
    let quality = Quality { set: set.name.clone(), digest: set.digest.clone(), figures: Vec::new(), variants };
    ([base, set], quality)
}

/// Returns the place of a scenario among the six.
fn place(cell: &Cell) -> usize {
    usize::from(cell.scenario.as_bytes()[0] - b'a')
}

/// Against adversaries the camera loses 0.6, 0.5, … 0.1 (on seed 2 0.05 more) and is hit in the first five; `lattice` loses nothing.
fn drive(cell: &Cell) -> Option<Record> {
    let adverse = cell.scenario.ends_with("__x") && cell.policy.name == "camera";
    let more = if cell.seed == 2 { 0.05 } else { 0.0 };
    let loss = if adverse { 0.6 - 0.1 * place(cell) as f64 + more } else { 0.0 };
    let Record { cell, episode, mut judged, .. } = driven(cell.clone(), "completed", 0.9 - loss);
    judged.as_mut().expect("completed").outcome.contact = adverse && place(&cell) < 5;
    Some(Record::new(cell, 0, episode, judged))
}

fn report_of(results: &Results) -> Report {
    Report::new(results, &|policy| policy == "idm", &Published::default())
}

#[test]
fn contacts_are_compared_with_each_variants_own_base_and_held_against_the_bar() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (sets, _) = adverse();
    let mut sheet = sheet::tests::sheet(&sets);
    sheet.policies.push(Named { name: "idm".to_owned(), ..Named::default() });
    let results = results_of(folder.path(), &sheet, &sets, drive);
    let report = report_of(&results);
    let contacts = table(&report, "contacts");
    for (column, value) in [("contact", 5.0 / 6.0), ("contact base", 0.0), ("difference", 5.0 / 6.0)] {
        assert!((found(contacts, &["camera"], column) - value).abs() < 1e-12, "{column}");
    }
    assert!((found(contacts, &["camera"], "DS strict") + 0.375).abs() < 1e-12);
    let bar = |policy: &str| {
        let row = contacts.rows.iter().find(|row| row[0].told() == policy).expect(policy);
        row.last().expect("a cell").told()
    };
    assert_eq!([bar("camera"), bar("lattice"), bar("idm (anchor)")], ["met", "missed", "none"]);
    let row = contacts.json()["rows"][1].clone();
    for interval in ["by_scenario", "by_log"] {
        assert!(row["difference"][interval][0].as_f64().is_some_and(|low| low > 0.0), "{row}");
    }
    // Without the base there is nothing to compare with.
    let folder = tempfile::tempdir().expect("a temporary folder");
    let alone = [sets[1].clone()];
    let report = report_of(&results_of(folder.path(), &sheet::tests::sheet(&alone), &alone, drive));
    let contacts = table(&report, "contacts").markdown();
    assert!(
        contacts.matches("not tested: the base was not driven | n/a | n/a | not measured |").count() == 2,
        "{contacts}"
    );
}

#[test]
fn the_worst_falls_stand_beside_their_base_on_one_seed() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (sets, _) = adverse();
    let mut sheet = sheet::tests::sheet(&sets);
    sheet.place.folders = vec!["my sets".into(), "my sets".into()];
    let mut results = results_of(folder.path(), &sheet, &sets, drive);
    let report = report_of(&results);
    let falls = table(&report, "falls");
    let told: Vec<[String; 4]> = falls.rows.iter().map(|row| [4, 5, 6, 9].map(|column| row[column].told())).collect();
    let expected = [["a__x", "a", "2", "65.0"], ["b__x", "b", "2", "55.0"], ["c__x", "c", "2", "45.0"]];
    assert_eq!(told, expected, "of the camera, which alone falls, the worst three on their worst seed");
    // Each side is one cell of a benchmark that is cut down to it, and the commands say which.
    let again = table(&report, "again");
    assert_eq!(again.rows.len(), 7);
    let (_, a) = (&again.rows[0], falls::worst(&results).remove(0));
    for (row, side) in again.rows.iter().zip(&a.sides) {
        let command = row[2].told();
        let shard = command.split(" --shard ").nth(1).and_then(|rest| rest.split(' ').next()).expect("a shard");
        let set = sets.iter().find(|set| set.entries.contains(side.entry)).expect("a set");
        let alone = Sheet { policies: vec![a.arm.policy.clone()], seeds: vec![a.seed], ..sheet.clone() };
        let cells = alone.cells(std::slice::from_ref(set)).expect("sound");
        let shard: Shard = shard.parse().expect("a shard");
        let keys: Vec<String> = shard.part(cells.keys()).map(ToString::to_string).collect();
        assert_eq!(keys, std::slice::from_ref(&side.key), "{command}");
        let manifest = format!("'my sets/{}.set.json'", set.name);
        assert!(command.contains(&manifest) && command.contains("--seed 2 ") && command.contains("--tracker lqr"));
    }
    let last = again.rows[6][2].told();
    assert!(last.starts_with("dreamstream benchmark report ") && last.matches("/falls/").count() == 6, "{last}");
    // With animations of the deepest, the page shows it and asks for the others only.
    let sides = a.sides.each_ref().map(|side| (side.key.clone(), format!("falls/{}.gif", side.name())));
    results.animations.extend(sides.clone());
    let report = report_of(&results);
    assert_eq!(table(&report, "again").rows.len(), 5);
    let page = crate::page::page(&report);
    assert!(sides.iter().all(|(_, path)| page.contains(&format!("src=\"./{path}\""))), "{sides:?}");
    assert_eq!(page.matches("<img").count(), 2);
    assert!(page.contains("base a: DS 90.0") && page.contains("variant a__x: DS 25.0"));
}

#[test]
fn severity_is_told_by_class_and_losses_by_margin() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (sets, quality) = adverse();
    let mut results = results(folder.path(), &sets, drive);
    results.quality = vec![quality];
    let report = report_of(&results);
    let severity = table(&report, "severity").markdown();
    // Closing at 2, 4, 6, 8 m/s in the one class and at 10, 12 m/s in the other.
    assert!(severity.contains("| hard | rear-end | 4 | 66.7 | 3.5 | 5.0 | 6.5 | 8.0 | 1.8 | 2.5 |"), "{severity}");
    assert!(severity.contains("| hard | changing-lanes | 2 | 33.3 | 10.5 | 11.0 | 11.5 | 12.0 |"), "{severity}");
    let losses = table(&report, "losses");
    assert!((found(losses, &["camera", "strict"], "rank correlation") + 1.0).abs() < 1e-12);
    let lattice = losses.rows.iter().find(|row| row[0].told() == "lattice").expect("a row");
    assert_eq!(
        (lattice[5].told(), lattice[6].told()),
        ("0.0".to_owned(), "n/a".to_owned()),
        "who loses nothing ranks nothing"
    );
    let Some([Plot::Scatter(scatter)]) = report.plots.get("losses").map(Vec::as_slice) else { panic!("no plot") };
    let camera = scatter.series.iter().find(|series| series.name.starts_with("camera")).expect("a series");
    assert_eq!(camera.points.len(), 6);
    assert!(camera.points.iter().any(|(x, y)| (x - 0.5).abs() < 1e-9 && (y - 0.625).abs() < 1e-9), "{camera:?}");
    assert_eq!(report.plots["severity"].len(), 2);
    let page = crate::page::page(&report);
    assert!(page.contains("hard: Closing speed") && page.contains("rear-end: 1 from 2.0 to 3.0"));
    // Incomplete results tell what was searched, and nothing of who drove it.
    results.cells += 1;
    let report = report_of(&results);
    let ids: Vec<&str> = report.tables.iter().map(|table| table.id).collect();
    assert!(ids.contains(&"severity") && !ids.contains(&"losses") && !ids.contains(&"falls"), "{ids:?}");
}

#[test]
fn what_was_lost_is_told_with_its_share() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let sets = [manifest::tests::set(&SIX)];
    let drive = |cell: &Cell| {
        let lost = cell.scenario == "a" && cell.seed == 1;
        let mut record = driven(cell.clone(), if lost { "aborted" } else { "completed" }, 0.5);
        (record.episode.wall_s, record.episode.attempts) = (5.0, if lost { 3 } else { 1 });
        if lost {
            record.episode.reason = "no_instance: video".to_owned();
            record.lost =
                crate::Losses { workers: [("video".to_owned(), 2)].into(), orders_repeated: 1, stalled_millis: 6_000 };
        }
        Some(record)
    };
    let report = report_of(&results(folder.path(), &sets, drive));
    let faults = table(&report, "faults").markdown();
    // Two policies of six scenarios on two seeds, 24 drives of 5 s; two of them aborted.
    for row in [
        "| attempts | 28 | n/a |",
        "| attempts beyond the first | 4 | n/a |",
        "| workers lost | 4 | n/a |",
        "| workers lost, role video | 4 | n/a |",
        "| aborted drives, reason no_instance | 2 | n/a |",
        "| seconds stalled | 12 | 10.0 |",
        "| seconds of wall time in drives | 120 | 100.0 |",
        "| seconds of it lost to aborted drives | 10 | 8.3 |",
    ] {
        assert!(faults.contains(row), "{row} is missing in {faults}");
    }
}
