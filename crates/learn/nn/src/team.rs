//! A team of workers, each with one thread of its own, that compute independent pieces of work side by side.
//!
//! The framework gains little from a second thread inside one operation, so whole training steps of a few clips run
//! beside each other instead, each confined to its worker's thread. Results come back in the order of the jobs, so
//! that nothing depends on the number of workers.

use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Workers of one thread each.
#[derive(Debug)]
pub struct Team {
    pools: Vec<rayon::ThreadPool>,
}

impl Team {
    /// Gathers a worker for each processor core.
    ///
    /// # Panics
    /// If the system starts no threads.
    #[must_use]
    pub fn of_all_cores() -> Self {
        Self::new(std::thread::available_parallelism().map_or(1, usize::from))
    }

    /// Gathers `workers` workers, at least one.
    ///
    /// # Panics
    /// If the system starts no threads.
    #[must_use]
    pub fn new(workers: usize) -> Self {
        keep_pages();
        let pool = |_| rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread can be started");
        Self { pools: (0..workers.max(1)).map(pool).collect() }
    }

    /// Returns the number of workers.
    #[must_use]
    pub fn workers(&self) -> usize {
        self.pools.len()
    }

    /// Runs a job for each number below `count` and returns the results in order.
    ///
    /// # Panics
    /// If a job panics.
    pub fn run<T: Send>(&self, count: usize, job: impl Fn(usize) -> T + Sync) -> Vec<T> {
        let results: Vec<Mutex<Option<T>>> = (0..count).map(|_| Mutex::new(None)).collect();
        let next = AtomicUsize::new(0);
        let work = || {
            loop {
                let at = next.fetch_add(1, Ordering::Relaxed);
                let Some(slot) = results.get(at) else { break };
                let result = job(at);
                *slot.lock().unwrap_or_else(PoisonError::into_inner) = Some(result);
            }
        };
        std::thread::scope(|scope| {
            for pool in &self.pools {
                scope.spawn(|| pool.install(work));
            }
        });
        let result = |slot: Mutex<Option<T>>| slot.into_inner().unwrap_or_else(PoisonError::into_inner);
        results.into_iter().map(|slot| result(slot).expect("every job was run")).collect()
    }
}

/// Asks the C library's allocator to keep the pages of freed tensors: giving them back and faulting them in again took
/// a third of a training step. Once is enough; other allocators go their own way.
fn keep_pages() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    {
        static ONCE: std::sync::Once = std::sync::Once::new();
        // Above the largest heap that the allocator accepts for the first, far above any training for the others.
        const LARGEST_HEAP: i32 = 32 << 20;
        ONCE.call_once(|| {
            // SAFETY: mallopt takes plain numbers and only changes when memory is given back to the system.
            unsafe {
                libc::mallopt(libc::M_MMAP_THRESHOLD, LARGEST_HEAP);
                libc::mallopt(libc::M_TRIM_THRESHOLD, i32::MAX);
                libc::mallopt(libc::M_TOP_PAD, 256 << 20);
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_come_in_the_order_of_the_jobs_whatever_the_team() {
        for workers in [1, 2, 5] {
            let found = Team::new(workers).run(20, |at| at * at);
            assert_eq!(found, (0..20).map(|at| at * at).collect::<Vec<_>>());
        }
    }
}
