//! What people say of variants, and how far two of them agree.

use crate::results::Results;
use crate::table::{Table, Value};

/// Returns of each set that somebody reviewed how many variants stay and why others do not.
pub(super) fn reviews(results: &Results) -> Table {
    let mut rows = Vec::new();
    for review in &results.reviews {
        let Some(set) = results.sets.iter().find(|set| set.name == review.set) else { continue };
        let by: Vec<&str> = review.by.iter().map(|by| by.reviewer.as_str()).collect();
        let agreement: Vec<String> = review
            .agreement(set)
            .into_iter()
            .map(|([a, b], count, kappa)| {
                let kappa = kappa.map_or("not defined".to_owned(), |kappa| format!("{kappa:.2}"));
                format!("{a}, {b}: {kappa} on {count}")
            })
            .collect();
        let mut row = vec![Value::text(&set.name), Value::count(set.entries.len())];
        row.extend(review.counts(set).map(Value::count));
        row.extend([Value::text(by.join(", ")), Value::text(agreement.join("; "))]);
        rows.push(row);
    }
    let note =
        "Verdicts of people beside the manifests. All tables hold the valid variants and, as a set of its own, those \
                that somebody accepted and nobody rejected. Kappa: agreement of two reviewers beyond chance."
            .to_owned();
    let columns = vec!["set", "variants", "accepted", "rejected", "unreviewed", "reviewers", "kappa"];
    Table { id: "reviews", title: "Review", note, columns, rows }
}
