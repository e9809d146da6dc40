//! The work of a bake shared out among threads.

/// Items that all threads work on together before their results are put down; the number of threads has no part in it, so
/// that what a bake writes does not depend on it.
pub(crate) const TURN: usize = 64;

/// The results of `work` on all items, in their order, by as many threads as there are hands.
pub(crate) fn share<H: Send, T: Sync, R: Send>(
    hands: &mut [H],
    items: &[T],
    work: impl Fn(&mut H, &T) -> R + Sync,
) -> Vec<R> {
    let part = items.len().div_ceil(hands.len().max(1)).max(1);
    let do_part = |hand: &mut H, items: &[T]| -> Vec<R> {
        items.iter().map(|item| work(hand, item)).collect()
    };
    let mut parts: Vec<Option<Vec<R>>> = Vec::new();
    parts.resize_with(items.len().div_ceil(part), || None);
    std::thread::scope(|scope| {
        let mut jobs = hands
            .iter_mut()
            .zip(parts.iter_mut().zip(items.chunks(part)));
        let own = jobs.next();
        for (hand, (result, items)) in jobs {
            let builder = std::thread::Builder::new().name("bake".into());
            let do_part = &do_part;
            // The part of a thread that cannot start is done below.
            let _ = builder.spawn_scoped(scope, move || *result = Some(do_part(hand, items)));
        }
        if let Some((hand, (result, items))) = own {
            *result = Some(do_part(hand, items));
        }
    });
    let mut all = Vec::with_capacity(items.len());
    for (result, items) in parts.into_iter().zip(items.chunks(part)) {
        match (result, hands.first_mut()) {
            (Some(result), _) => all.extend(result),
            (None, Some(hand)) => all.extend(do_part(hand, items)),
            (None, None) => {}
        }
    }
    all
}
