//! Race detection in debug builds: reports a task that writes an item of a shared array while another running task
//! reads or writes it. It detects conflicts that overlap in time, except with a reader that was followed by another
//! reader.
//!
//! Every running task has a ticket. Every item remembers the ticket of the last task that read it and of the last that
//! wrote it.

use std::sync::atomic::{AtomicU64, Ordering};

/// Maximum number of concurrent tasks that are watched.
const SLOTS: usize = 256;
/// The ticket of the task that runs in each slot; 0 if the slot is free. A ticket is a serial number times [`SLOTS`]
/// plus the slot.
static RUNNING: [AtomicU64; SLOTS] = [const { AtomicU64::new(0) }; SLOTS];
static NEXT: AtomicU64 = AtomicU64::new(1);

/// The ticket of a running task, returned when dropped; 0 if there was no free slot.
pub(super) struct Ticket(u64);

impl Ticket {
    pub(super) fn take() -> Ticket {
        let number = NEXT.fetch_add(1, Ordering::SeqCst) * SLOTS as u64;
        for (slot, running) in RUNNING.iter().enumerate() {
            let ticket = number + slot as u64;
            if running.compare_exchange(0, ticket, Ordering::SeqCst, Ordering::SeqCst).is_ok() {
                return Ticket(ticket);
            }
        }
        Ticket(0)
    }

    pub(super) fn number(&self) -> u64 {
        self.0
    }
}

impl Drop for Ticket {
    fn drop(&mut self) {
        if self.0 != 0 {
            RUNNING[self.0 as usize % SLOTS].store(0, Ordering::SeqCst);
        }
    }
}

/// The last visitors of each item.
pub(super) struct Visitors(Vec<Last>);

#[derive(Debug, Default)]
struct Last {
    reader: AtomicU64,
    writer: AtomicU64,
}

impl Visitors {
    pub(super) fn new(items: usize) -> Visitors {
        Visitors((0..items).map(|_| Last::default()).collect())
    }

    pub(super) fn read(&self, item: usize, ticket: u64) {
        let last = &self.0[item];
        last.reader.store(ticket, Ordering::SeqCst);
        assert!(!meets(last.writer.load(Ordering::SeqCst), ticket), "item {item} is read while another task writes it");
    }

    pub(super) fn write(&self, item: usize, ticket: u64) {
        let last = &self.0[item];
        let before = last.writer.swap(ticket, Ordering::SeqCst);
        assert!(!meets(before, ticket), "item {item} is written by two tasks at once");
        assert!(!meets(last.reader.load(Ordering::SeqCst), ticket), "item {item} is written while another task reads it");
    }
}

/// Whether a ticket belongs to another task that is still running.
fn meets(other: u64, ticket: u64) -> bool {
    other != 0 && other != ticket && RUNNING[other as usize % SLOTS].load(Ordering::SeqCst) == other
}
