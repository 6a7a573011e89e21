//! What the fleet must never forget: the term, epochs and holders, deaths and failures; and how it is stored.
//!
//! The orchestrator implements it over an embedded database file that only one process can hold open.

/// The ledger could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum LedgerError {
    /// Another orchestrator opened the ledger later.
    #[error("term {own} was fenced off by term {current}")]
    Fenced {
        /// The term of the writer.
        own: u64,
        /// The term in charge.
        current: u64,
    },
    /// An entry cannot be read.
    #[error("ledger entry {key:?} cannot be read: {detail}")]
    Broken {
        /// Its key.
        key: String,
        /// What is wrong with it.
        detail: String,
    },
    /// The storage failed.
    #[error("ledger storage failed: {0}")]
    Storage(String),
}

/// A write: a key and its new value, `None` to remove it.
pub type Write = (String, Option<Vec<u8>>);

/// Durable, transactional storage of small entries under text keys, fenced by a term.
pub trait Ledger {
    /// Raises the term durably by one and returns it; 1 on an empty ledger.
    ///
    /// # Errors
    /// [`LedgerError`] if storage fails.
    fn raise_term(&mut self) -> Result<u64, LedgerError>;

    /// Returns the term in charge, 0 on an empty ledger.
    ///
    /// # Errors
    /// [`LedgerError`] if storage fails.
    fn term(&self) -> Result<u64, LedgerError>;

    /// Returns all entries whose key starts with `prefix`, by key.
    ///
    /// # Errors
    /// [`LedgerError`] if storage fails.
    fn entries(&self, prefix: &str) -> Result<Vec<(String, Vec<u8>)>, LedgerError>;

    /// Applies all writes in one durable transaction, if `term` is still the term in charge.
    ///
    /// # Errors
    /// [`LedgerError::Fenced`] if it is not; nothing is written then.
    fn commit(&mut self, term: u64, writes: &[Write]) -> Result<(), LedgerError>;
}
