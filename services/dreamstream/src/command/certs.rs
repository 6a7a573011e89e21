//! `certs`: what a fleet on a network needs.

use anyhow::Result;
use ds_process::certs::{Wanted, make};
use ds_process::terminal::answer;

use crate::cli::CertsArgs;

/// Makes what is missing in the folder.
///
/// # Errors
/// If a name is refused or a file cannot be read or written.
pub(crate) fn run(args: &CertsArgs) -> Result<()> {
    let wanted = Wanted { folder: &args.out, policies: &args.policies, hosts: &args.hosts, days: args.days };
    let (made, kept) = make(&wanted)?;
    answer(&format!("{made} made, {kept} kept, in {}", args.out.display()));
    Ok(())
}
