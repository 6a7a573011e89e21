//! Laws of the generator, over many seeds.

use super::*;

#[test]
fn report() {
    for family in Family::ALL {
        let (mut faults, mut first) = (0, Vec::new());
        for seed in 0..20 {
            if let Some(fault) = check::fault(&attempt(family, seed, 0)) {
                faults += 1;
                first.push(fault);
            }
        }
        eprintln!("{family}: {faults} {first:#?}");
    }
}
