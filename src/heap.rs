//! The allocator, counted: the system's own, with a count of allocations per thread.
//!
//! "No allocation in the frame loop once running" is a promise of this program; this module lets it be checked in every run
//! (`run --stats`: `allocations_after_ready`) and in tests. It is a hazard module only because implementing
//! [`GlobalAlloc`] is unsafe; it adds one thread-local increment to an allocation and nothing to anything else.

#![expect(
    unsafe_code,
    reason = "GlobalAlloc is an unsafe trait, every method of which forwards to System unchanged; mallopt is C"
)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

/// The system allocator with a count per thread.
#[derive(Debug)]
pub struct Counted;

#[global_allocator]
static GLOBAL: Counted = Counted;

/// Allocations and reallocations made by the calling thread since it started.
#[must_use]
pub fn allocations_of_this_thread() -> u64 {
    ALLOCATIONS.try_with(Cell::get).unwrap_or(0)
}

/// Makes the C library keep this much freed memory instead of giving it back to the system, bytes.
///
/// Drivers that draw in software free megabytes at the end of every frame and ask for them again in the next; given back,
/// each page comes with a fault and is cleared: a seventh of a frame's CPU time with 127 vertices a level.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const KEPT_BYTES: std::ffi::c_int = 32 << 20;

/// Tells the C library to keep freed memory. To be called once, at the start; does nothing where there is no such setting.
pub fn keep_freed_memory() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    {
        /// Of malloc.h: above so many bytes at the end of the heap, they are given back.
        const TRIM_THRESHOLD: std::ffi::c_int = -1;
        /// Of malloc.h: pieces of so many bytes and more are got and given back one by one.
        const MMAP_THRESHOLD: std::ffi::c_int = -3;
        /// Above what a frame asks for in one piece; far below what the textures and files of a pack are.
        const SINGLE_BYTES: std::ffi::c_int = 4 << 20;
        unsafe extern "C" {
            fn mallopt(parameter: std::ffi::c_int, value: std::ffi::c_int) -> std::ffi::c_int;
        }
        // SAFETY: glibc has this function with this type since 2.0; it takes a number and sets one.
        unsafe {
            mallopt(TRIM_THRESHOLD, KEPT_BYTES);
            mallopt(MMAP_THRESHOLD, SINGLE_BYTES);
        }
    }
}

fn count() {
    // A thread that is ending has no thread-locals any more; nobody reads its count either.
    let _ = ALLOCATIONS.try_with(|n| n.set(n.get() + 1));
}

// SAFETY: every method forwards its arguments unchanged to `System`, which upholds the contract of `GlobalAlloc`; the
// counter is a const-initialised thread-local without a destructor, so touching it never allocates.
unsafe impl GlobalAlloc for Counted {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller upholds `alloc`'s contract for `layout`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller upholds `alloc_zeroed`'s contract for `layout`.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, ptr: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        count();
        // SAFETY: the caller upholds `realloc`'s contract: `ptr` came from this allocator, that is from `System`.
        unsafe { System.realloc(ptr, layout, new_size) }
    }

    unsafe fn dealloc(&self, ptr: *mut u8, layout: Layout) {
        // SAFETY: the caller upholds `dealloc`'s contract: `ptr` came from this allocator, that is from `System`.
        unsafe { System.dealloc(ptr, layout) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_allocation_is_counted_on_its_own_thread_only() {
        let before = allocations_of_this_thread();
        let boxed = std::hint::black_box(Box::new([0_u8; 64]));
        assert!(allocations_of_this_thread() > before, "the box was counted");
        drop(boxed);
        let here = allocations_of_this_thread();
        std::thread::scope(|scope| {
            let other = scope.spawn(|| {
                let before = allocations_of_this_thread();
                let v = std::hint::black_box(vec![1_u8; 4096]);
                assert!(
                    allocations_of_this_thread() > before,
                    "{} bytes counted there",
                    v.len()
                );
            });
            assert!(other.join().is_ok(), "the other thread's assertion held");
        });
        // Spawning itself allocates here; the 4096 bytes over there must not be the only thing that is seen.
        assert!(allocations_of_this_thread() >= here, "counts never fall");
    }
}
