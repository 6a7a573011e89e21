//! Where the first failed write of ledger or journal is told: it ends the orchestrator, nothing of it is recorded.
//!
//! A full disk is no fault of a drive. Drives under way keep their last commit, so that they go on once there is room.

use std::sync::Arc;

use ds_process::service::StorageError;
use tokio::sync::watch;

/// The state of the storage, shared by ledger, admission and server.
#[derive(Debug, Clone, Default)]
pub(crate) struct Storage(Arc<watch::Sender<Option<String>>>);

impl Storage {
    /// Says that a write failed; the first reason stays.
    pub(crate) fn fail(&self, reason: String) {
        self.0.send_if_modified(|first| {
            let news = first.is_none();
            first.get_or_insert(reason);
            news
        });
    }

    /// Tells whether a write failed.
    pub(crate) fn has_failed(&self) -> bool {
        self.0.borrow().is_some()
    }

    /// Waits until a write fails.
    pub(crate) async fn failure(&self) -> StorageError {
        let mut changes = self.0.subscribe();
        let reason = changes.wait_for(Option::is_some).await.map(|reason| reason.clone());
        StorageError(reason.ok().flatten().unwrap_or_default())
    }
}
