//! Reports of made-up results: what is averaged, paired, withheld.

use std::path::Path;

use ds_world::AgentMode;

use super::*;
use crate::cell::{Cell, Named, Shard};
use crate::manifest;
use crate::record::tests::driven;
use crate::record::{Record, Writer};
use crate::sheet::{self, Sheet};

mod adversaries;

/// Writes a folder of results over sets, each cell as `drive` says, and reads it.
fn results(folder: &Path, sets: &[Manifest], drive: impl Fn(&Cell) -> Option<Record>) -> Results {
    results_of(folder, &sheet::tests::sheet(sets), sets, drive)
}

fn results_of(folder: &Path, sheet: &Sheet, sets: &[Manifest], drive: impl Fn(&Cell) -> Option<Record>) -> Results {
    let sheet = Sheet { shard: Shard::ALL, ..sheet.clone() };
    sheet.save(sets, folder).expect("written");
    let (mut writer, _) = Writer::open(folder, |_| ()).expect("fresh");
    for (cell, _) in sheet.cells(sets).expect("sound").into_values() {
        if let Some(record) = drive(&cell) {
            writer.append(&record).expect("written");
        }
    }
    Results::load(folder).expect("sound")
}

fn table<'a>(report: &'a Report, id: &str) -> &'a Table {
    report.tables.iter().find(|table| table.id == id).expect(id)
}

/// Returns the estimate of a row that begins with some words.
fn found(table: &Table, words: &[&str], column: &str) -> f64 {
    let place = table.columns.iter().position(|name| *name == column).expect(column);
    let fits = |row: &&Vec<Value>| words.iter().all(|word| row.iter().any(|value| value.told() == *word));
    let rows: Vec<_> = table.rows.iter().filter(fits).collect();
    assert_eq!(rows.len(), 1, "{words:?} in {}", table.markdown());
    let Value::Estimate(estimate, _) = &rows[0][place] else { panic!("{column} is no estimate") };
    estimate.value.expect("a value")
}

const SIX: [&str; 6] = ["a", "b", "c", "d", "e", "f"];

#[test]
fn seeds_are_averaged_and_policies_are_paired() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let sets = [manifest::tests::set(&SIX)];
    let drive = |cell: &Cell| {
        let base = f64::from(cell.scenario.as_bytes()[0] - b'a') / 10.0;
        let gain = if cell.policy.name == "camera" { 0.2 } else { 0.0 };
        let status = if cell.scenario == "f" && cell.policy.name == "lattice" { "failed" } else { "completed" };
        Some(driven(cell.clone(), status, base + gain + 0.1 * (cell.seed as f64 - 1.0)))
    };
    let results = results(folder.path(), &sets, drive);
    let report = Report::new(&results, &|name| name == "camera", &Published::default());
    assert!(report.complete && report.warnings.is_empty());
    let policies = table(&report, "policies");
    // Seeds 1 and 2 add 0.05: lattice (0.05 + … + 0.45 + 0)/6 with one failed scenario, camera (0.25 + … + 0.75)/6.
    assert!((found(policies, &["lattice", "strict"], "DS") - 1.25 / 6.0).abs() < 1e-12);
    assert!((found(policies, &["camera (anchor)", "bridgesim"], "DS") - 0.5).abs() < 1e-12);
    let differences = table(&report, "differences");
    let expected = (5.0 * 0.2 + 0.75) / 6.0;
    assert!((found(differences, &["DS strict"], "difference") - expected).abs() < 1e-12);
    let outcomes = table(&report, "outcomes");
    // Drives above 0.5 arrive: of the camera's those of d with seed 2, of e and f with both seeds.
    let success = found(outcomes, &["camera (anchor)"], "success");
    assert!((success - 2.5 / 6.0).abs() < 1e-12, "{success}");
    assert!(table(&report, "faults").markdown().contains("| failed by the policy | 2 |"));
    crate::page::write(&report, folder.path()).expect("written");
    let json: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.path().join("report.json")).expect("there")).expect("JSON");
    assert_eq!(json["complete"], true);
    assert!(json["tables"]["policies"]["rows"][0]["DS"]["interval"][1].is_number(), "{json}");
    for file in ["report.html", "report.md", "tables/policies.csv", "tables/policies.arrow", "tables/faults.csv"] {
        assert!(std::fs::metadata(folder.path().join(file)).is_ok_and(|file| file.len() > 100), "{file}");
    }
}

#[test]
fn incomplete_and_mixed_results_have_no_headline_and_say_so() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let sets = [manifest::tests::set(&SIX)];
    let drive = |cell: &Cell| match cell.scenario.as_str() {
        "a" => None,
        "b" => Some(driven(cell.clone(), "aborted", 0.5)),
        _ => Some(driven(cell.clone(), "completed", 0.5)),
    };
    let mut results = results(folder.path(), &sets, drive);
    results.sheet.mixed = true;
    let report = Report::new(&results, &|_| false, &Published::default());
    assert!(!report.complete && report.warnings[0].contains("16 of 24") && report.warnings[1].contains("Mixed"));
    assert!(crate::page::page(&report).contains("16 of 24") && crate::page::markdown(&report).contains("16 of 24"));
    let ids: Vec<&str> = report.tables.iter().map(|table| table.id).collect();
    assert_eq!(ids, ["faults", "sets"]);
    // Tables of the report before are gone, files of others are not.
    let tables = folder.path().join("tables");
    let whole = Report { tables: vec![Table { id: "policies", ..report.tables[0].clone() }], ..report };
    crate::page::write(&whole, folder.path()).expect("written");
    std::fs::write(tables.join("mine.csv"), "mine").expect("written");
    let report = Report::new(&results, &|_| false, &Published::default());
    assert!(tables.join("policies.csv").exists());
    crate::page::write(&report, folder.path()).expect("written");
    for (file, stays) in [("policies.csv", false), ("policies.arrow", false), ("faults.csv", true), ("mine.csv", true)]
    {
        assert_eq!(tables.join(file).exists(), stays, "{file}");
    }
    let faults = table(&report, "faults").markdown();
    assert!(
        faults.contains("| never driven | 4 |") && faults.contains("| aborted and not driven since | 4 |"),
        "{faults}"
    );
}

#[test]
fn records_of_another_benchmark_count_for_nothing_and_are_told() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let sets = [manifest::tests::set(&SIX)];
    // A drive of every cell but one scenario's, and of that scenario with other weights.
    let drive = |cell: &Cell| {
        let mut cell = cell.clone();
        if cell.scenario == "a" {
            cell.policy.digest = "other weights".to_owned();
        }
        Some(driven(cell, "completed", 0.5))
    };
    let results = results(folder.path(), &sets, drive);
    assert_eq!((results.ended(), results.cells, results.foreign), (20, 24, 4));
    let report = Report::new(&results, &|_| false, &Published::default());
    assert!(!report.complete && report.warnings[0].contains("20 of 24"), "{:?}", report.warnings);
    assert!(report.warnings[1].starts_with("4 records of other benchmarks"), "{:?}", report.warnings);
}

/// Returns a set and the same under all conditions.
fn under_conditions() -> [Manifest; 2] {
    let base = manifest::tests::set(&SIX);
    let weather: Vec<_> = base.entries.iter().flat_map(crate::Entry::under_conditions).collect();
    [base, Manifest::new("some-weather", Kind::Weather, crate::Recipe::default(), weather)]
}

fn shipped_endpoints() -> Vec<crate::endpoint::Endpoint> {
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs/benchmark/plan.toml");
    crate::endpoint::load(&shipped).expect("sound")
}

#[test]
fn conditions_are_compared_with_their_own_base() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let drive = |cell: &Cell| {
        let loss = match cell.appearance.as_str() {
            "day" => 0.0,
            "snow" => 0.2,
            _ => 0.1,
        };
        Some(driven(cell.clone(), "completed", 0.9 - loss))
    };
    let results = results(folder.path(), &under_conditions(), drive);
    let report = Report::new(&results, &|_| false, &Published::default());
    let weather = table(&report, "weather");
    assert_eq!(weather.rows.len(), 2 * 2 * 16);
    let of = |condition: &str, axis: &str| found(weather, &["camera", "strict", axis, condition], "difference");
    assert!((of("snow", "weather") + 0.2).abs() < 1e-9 && (of("fog", "weather") + 0.1).abs() < 1e-9);
    assert!((of("mean", "weather") + 0.125).abs() < 1e-9 && (of("mean", "lighting") + 0.1).abs() < 1e-9);
    assert!(weather.note.contains("appearance alone"));
    let parts = table(&report, "conditions");
    let part = |condition: &str, column: &str| found(parts, &["camera", "strict", "weather", condition], column);
    assert!((part("snow", "EPDMS") + 0.2).abs() < 1e-9 && part("snow", "RC").abs() < 1e-9);
    assert!((part("mean", "EC") + 0.125).abs() < 1e-9 && part("fog", "NC").abs() < 1e-9);
}

#[test]
fn a_condition_that_is_not_shown_supports_no_claim() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (sets, endpoints) = (under_conditions(), shipped_endpoints());
    let mut sheet = Sheet { endpoints, seeds: vec![1], ..sheet::tests::sheet(&sets) };
    let source = |name: &str, digest: &str| Named { name: name.to_owned(), digest: digest.to_owned() };
    sheet.observations = vec![source("dreamstream", "a model"), source("reference", ""), source("layout", "")];
    // Rain is named on half of the frames on which the reference camera shows it, snow on five of six, fog was not looked
    // at, and nobody can tell puddles even on reference frames.
    let drive = |cell: &Cell| {
        let index = usize::from(cell.scenario.as_bytes()[0] - b'a');
        let (frame, reference) = match cell.appearance.as_str() {
            "rain" => (index < 3, true),
            "snow" => (index < 5, true),
            "puddles" => (false, false),
            _ => (true, true),
        };
        let generated = cell.observation.name == "dreamstream";
        let looked = generated && !["day", "fog"].contains(&cell.appearance.as_str());
        let shown = looked.then_some(crate::ConditionShown { frame, reference });
        let score = if cell.appearance == "day" { 0.9 } else { 0.7 };
        Some(Record { shown, ..driven(cell.clone(), "completed", score) })
    };
    let results = results_of(folder.path(), &sheet, &sets, drive);
    let report = Report::new(&results, &|_| false, &Published::default());
    let weather = table(&report, "weather");
    let row_of = |how: &str, axis: &str, condition: &str| {
        let words = ["camera", how, "strict", axis, condition];
        let fits = |row: &&Vec<Value>| words.iter().all(|word| row.iter().any(|value| value.told() == *word));
        let row = weather.rows.iter().find(fits).expect("a row");
        [9, 12].map(|column| row[column].told())
    };
    let row = |axis: &str, condition: &str| row_of("dreamstream · idm-all · learned", axis, condition);
    assert_eq!(row("weather", "rain"), ["—", "condition not shown"]);
    assert_eq!(row("weather", "fog"), ["—", "condition not measured"]);
    assert_eq!(row("surface", "puddles")[1], "condition not shown");
    assert!(
        row("weather", "mean")[1].starts_with("condition not") && row("surface", "mean")[1].starts_with("condition")
    );
    assert!(row("weather", "snow")[1].ends_with("at 5 %") && row("lighting", "mean")[1].ends_with("at 5 %"));
    assert_ne!(row("weather", "snow")[0], "—");
    let shown = table(&report, "shown").markdown();
    assert!(
        row_of("reference · idm-all · learned", "weather", "rain")[1].ends_with("at 5 %"),
        "it renders what it is told"
    );
    let row = row_of("layout · idm-all · learned", "weather", "rain");
    assert_eq!(row, ["—", "condition not shown: this source has no look"]);
    let parts = table(&report, "conditions").markdown();
    let of_rain = parts.lines().filter(|line| line.contains("| dreamstream · ") && line.contains("| rain |"));
    assert!(of_rain.count() == 4 && parts.matches("| condition not shown |").count() > 4, "{parts}");
    assert!(shown.contains("| weather | rain | 12 | 6 | 12 | 50.0 | 100.0 | 50.0 | condition not shown |"), "{shown}");
    assert!(shown.contains("| weather | snow | 12 | 10 | 12 | 83.3 | 100.0 | 83.3 | shown |"), "{shown}");
    let differences = table(&report, "differences").markdown();
    let pairs = |set: &str| differences.lines().filter(|line| line.contains(&format!("| {set} |"))).collect::<Vec<_>>();
    let of_weather = pairs("some-weather");
    let untested = |line: &&&str| line.contains("condition not");
    let looks = |line: &str| line.contains("dreamstream ·") || line.contains("layout ·");
    assert!(of_weather.iter().all(|line| untested(&line) == looks(line)), "{differences}");
    assert!(!pairs("some").iter().any(|line| untested(&line)), "by day there is nothing to show");
    let warned = |said: &&String| said.contains("dreamstream") && said.contains("rain, fog, puddles");
    assert_eq!(report.warnings.iter().filter(warned).count(), 1, "{:?}", report.warnings);
    let page = crate::page::page(&report);
    assert!(page.contains("camera · some-weather · strict · dreamstream<"), "dots are told apart by what differs");
    let endpoints = table(&report, "endpoints");
    let axes = endpoints.rows.iter().find(|row| row[0].told().contains("than the lighting")).expect("declared");
    assert_eq!(axes.last().map(Value::told).as_deref(), Some("not tested"));
}

#[test]
fn an_oracle_is_compared_with_the_policy_and_adversaries_with_their_base() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let base = manifest::tests::set(&SIX);
    let variant = |entry: &crate::Entry| crate::Entry {
        name: format!("{}__rear-end", entry.name),
        scenario: format!("{}__rear-end", entry.scenario),
        base: Some(entry.name.clone()),
        category: "rear-end".to_owned(),
        ..entry.clone()
    };
    let entries = base.entries.iter().take(5).map(variant).collect();
    let adversaries = Manifest::new("some-behavior", Kind::Behavior, crate::Recipe::default(), entries);
    let sets = [base, adversaries];
    let scorers = ["learned", "oracle"].map(str::to_owned).to_vec();
    let sheet = Sheet { scorers, ..sheet::tests::sheet(&sets) };
    let drive = |cell: &Cell| {
        let (oracle, hit) = (cell.scorer == "oracle", cell.scenario.ends_with("rear-end"));
        let gain = if oracle { 0.1 } else { 0.0 };
        let loss = if hit { 0.3 } else { 0.0 };
        let mut record = driven(cell.clone(), "completed", 0.5 + gain - loss);
        let stats = ds_run_report::ProposalStats { best_mean: 0.75, ticks_without_positive: 4, ticks: 16 };
        record.episode.proposals = oracle.then_some(stats);
        Some(record)
    };
    let results = results_of(folder.path(), &sheet, &sets, drive);
    let report = Report::new(&results, &|_| false, &Published::default());
    let bias = table(&report, "bias");
    let of = |column: &str| found(bias, &["camera", "some", "strict"], column);
    assert!((of("difference") - 0.1).abs() < 1e-9 && (of("best proposal") - 0.75).abs() < 1e-9);
    assert!(
        (of("ticks without positive") - 0.25).abs() < 1e-9 && (of("scenarios without positive") - 1.0).abs() < 1e-9
    );
    assert!(
        report.warnings.iter().any(|said| said.starts_with("Set some-behavior: no figures")),
        "{:?}",
        report.warnings
    );
    let behavior = table(&report, "behavior");
    let words = ["camera", "some-behavior", "layout · idm-all · oracle", "strict", "rear-end"];
    assert!((found(behavior, &words, "difference") + 0.3).abs() < 1e-9);
    assert!((found(behavior, &words, "DS") - 0.3).abs() < 1e-9);
}

#[test]
fn contacts_on_two_sets_of_the_same_bases_are_paired_for_each_way_of_driving() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    // The same variants in two modes: their scenarios bear one name.
    let of_mode = |mode: &str| {
        let variant = |name: &str| crate::Entry {
            name: format!("{name}__rear-end"),
            base: Some(name.to_owned()),
            ..manifest::tests::entry(&format!("{name}__rear-end"), mode)
        };
        let scenario = |entry: crate::Entry| {
            let digest = ds_space::Digest::of(format!("{} {mode}", entry.name).as_bytes()).to_string();
            crate::Entry { scenario_digest: digest, ..entry }
        };
        let entries = SIX.map(variant).map(scenario).to_vec();
        Manifest::new(mode, Kind::Behavior, crate::Recipe::default(), entries)
    };
    let sets = ["replay", "reactive"].map(of_mode);
    let claim = crate::endpoint::Claim::Contacts {
        policy: "camera".to_owned(),
        first: sets[0].name.clone(),
        second: sets[1].name.clone(),
    };
    let (name, profile) = ("reacting meets more".to_owned(), "strict".to_owned());
    let endpoint = crate::endpoint::Endpoint { name, profile, direction: crate::endpoint::Direction::Up, claim };
    let mut sheet = Sheet { endpoints: vec![endpoint], ..sheet::tests::sheet(&sets) };
    sheet.agents.push(AgentMode::LogReplay);
    let drive = |cell: &Cell| {
        let reactive = sets[1].entries.iter().any(|entry| entry.scenario_digest == cell.scenario_digest);
        let Record { cell, episode, mut judged, .. } = driven(cell.clone(), "completed", 0.5);
        let last = if reactive { "d" } else { "b" };
        judged.as_mut().expect("completed").outcome.contact = &cell.scenario[..1] <= last;
        Some(Record::new(cell, 0, episode, judged))
    };
    let results = results_of(folder.path(), &sheet, &sets, drive);
    let report = Report::new(&results, &|_| false, &Published::default());
    let table = table(&report, "endpoints");
    assert_eq!(table.rows.len(), 2, "one for each mode of the agents: {}", table.markdown());
    for (column, value) in [("first", 2.0 / 6.0), ("second", 4.0 / 6.0), ("ratio", 2.0), ("difference", 2.0 / 6.0)] {
        assert!((found(table, &["layout · idm-all · learned"], column) - value).abs() < 1e-12, "{column}");
    }
    let behavior = self::table(&report, "behavior");
    let alone =
        |row: &Vec<Value>| row.last().map(Value::told).as_deref() == Some("not tested: the base was not driven");
    assert!(behavior.rows.iter().all(alone), "{}", behavior.markdown());
}

#[test]
fn declared_endpoints_are_tested_together() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (sets, endpoints) = (under_conditions(), shipped_endpoints());
    let mut sheet = Sheet { endpoints, ..sheet::tests::sheet(&sets) };
    sheet.policies[0].name = "constant-velocity".to_owned();
    sheet.observations[0].name = "reference".to_owned();
    let drive = |cell: &Cell| {
        let gain = if cell.policy.name == "camera" { 0.2 } else { 0.0 };
        let loss = match cell.appearance.as_str() {
            "puddles" | "snow_covered" | "sand_covered" => 0.2,
            "day" | "snow" | "rain" => 0.0,
            _ => 0.1,
        };
        Some(driven(cell.clone(), "completed", 0.6 + gain - loss))
    };
    let results = results_of(folder.path(), &sheet, &sets, drive);
    let report = Report::new(&results, &|_| false, &Published::default());
    let table = table(&report, "endpoints");
    let conclusions: Vec<String> = table.rows.iter().map(|row| row.last().expect("a cell").told()).collect();
    // Six scenarios of one sign: p = 1/32, times the rows that are left: above 5 % until all but one are told.
    assert_eq!(conclusions, ["not found", "not found", "not tested", "not found", "not found"]);
    let of = |endpoint: &str| found(table, &[endpoint], "difference");
    assert!((of("a camera helps: camera above constant velocity") - 0.2).abs() < 1e-9);
    // Weather loses (0 + 0 + 0.1 + 0.1)/4, lighting 0.1, the surface 0.2.
    assert!((of("the road surface costs more than the weather") + 0.15).abs() < 1e-9);
    assert!((of("the weather costs more than the lighting") - 0.05).abs() < 1e-9);
}

#[test]
fn a_subset_is_selected_on_seeds_of_its_own_and_its_own_fall_is_told() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let base = manifest::tests::set(&SIX);
    let rain = base.entries.iter().map(|entry| manifest::Entry {
        name: format!("{}@rain", entry.name),
        base: Some(entry.name.clone()),
        appearance: "rain".to_owned(),
        ..entry.clone()
    });
    let weather = Manifest::new("rainy", Kind::Weather, manifest::Recipe::default(), rain.collect());
    let sets = [base, weather];
    let sheet = Sheet { selection: vec![0], ..sheet::tests::sheet(&sets) };
    // On the selection seed the first four score 0.9; driven anew 0.7, in rain 0.6. The camera's do not move.
    let drive = |cell: &Cell| {
        let high = cell.scenario.as_str() < "e";
        let score = match (cell.policy.name.as_str(), high, cell.seed, cell.appearance.as_str()) {
            ("camera", true, ..) | (_, true, 0, _) => 0.9,
            (_, true, _, "rain") => 0.6,
            (_, true, ..) => 0.7,
            _ => 0.5,
        };
        Some(driven(cell.clone(), "completed", score))
    };
    let results = results_of(folder.path(), &sheet, &sets, drive);
    assert_eq!(results.cells, 2 * 6 * (3 + 2));
    let report = Report::new(&results, &|_| false, &Published::default());
    let subset = table(&report, "subset");
    assert!((found(subset, &["lattice", "strict", "own fall"], "difference") + 0.2).abs() < 1e-12);
    assert!((found(subset, &["lattice", "strict", "rain"], "difference") + 0.1).abs() < 1e-12);
    assert!((found(subset, &["lattice", "strict", "rain"], "DS") - 0.6).abs() < 1e-12);
    assert!(found(subset, &["camera", "strict", "own fall"], "difference").abs() < 1e-12);
    let seedless = |policy: &str| {
        let row = subset.rows.iter().find(|row| row[0].told() == policy).expect("a row");
        [row[4].told(), row[5].told()]
    };
    assert_eq!([seedless("lattice"), seedless("camera")], [["4", "0"], ["4", "4"]].map(|pair| pair.map(String::from)));
}

#[test]
fn accepted_variants_are_a_set_of_their_own() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut set = manifest::tests::set(&SIX);
    set.kind = Kind::Behavior;
    set.entries.iter_mut().for_each(|entry| entry.adversary_digest = Some(entry.scenario_digest.clone()));
    let set = Manifest::new("hard", Kind::Behavior, set.recipe, set.entries);
    let sets = [set];
    let drive = |cell: &Cell| Some(driven(cell.clone(), "completed", if cell.scenario == "a" { 1.0 } else { 0.4 }));
    let results = results(folder.path(), &sets, drive);
    let mut verdicts = crate::Verdicts::of(folder.path(), &sets[0], "anna").expect("none yet");
    verdicts.take(&sets[0], &["a".to_owned()], &[("b".to_owned(), "no road".to_owned())]).expect("sound");
    verdicts.save(folder.path(), &sets[0]).expect("written");
    let review = crate::Review::beside(folder.path(), &sets[0]).expect("sound");
    let report = Report::new(&results.reviewed(vec![review]), &|_| false, &Published::default());
    let policies = table(&report, "policies");
    assert!((found(policies, &["camera", "hard", "strict"], "DS") - 0.5).abs() < 1e-12);
    assert!((found(policies, &["camera", "hard (accepted)", "strict"], "DS") - 1.0).abs() < 1e-12);
    assert!(table(&report, "reviews").markdown().contains("| hard | 6 | 1 | 1 | 4 | anna |"));
}
