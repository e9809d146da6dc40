//! `glasswing terrain info`: what is in a pack.

use crate::app::out::say;
use crate::app::terrain::PackArgs;
use crate::terrain::pack::{Bounds, Pack};
use crate::terrain::partition::Partition;
use serde_json::{Value, json};
use std::path::Path;

/// What the index says of each level of a partition.
struct LevelSummary {
    tiles: u64,
    bytes: u64,
}

fn partitions(pack: &Pack) -> impl Iterator<Item = Partition> + '_ {
    Partition::ALL.into_iter().filter(|p| pack.info().has(*p))
}

fn level_summaries(pack: &Pack, partition: Partition) -> Vec<LevelSummary> {
    (0..pack.info().levels)
        .map(|level| {
            let of_level = pack
                .keys()
                .filter(|k| k.partition == partition && k.level == level);
            let headers = of_level.filter_map(|k| pack.tile_header(k));
            headers.fold(LevelSummary { tiles: 0, bytes: 0 }, |s, h| LevelSummary {
                tiles: s.tiles + 1,
                bytes: s.bytes + u64::from(h.stored_bytes),
            })
        })
        .collect()
}

/// Bits of stored tiles for each post of the ground.
fn bits_per_sample(bytes: u64, posts: u64) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "a figure for people")]
    {
        bytes as f64 * 8.0 / posts.max(1) as f64
    }
}

/// Of the finest level.
fn max_error_m(pack: &Pack, partition: Partition) -> f32 {
    let keys = pack
        .keys()
        .filter(|k| k.partition == partition && k.level == 0);
    let headers = keys.filter_map(|k| pack.tile_header(k));
    headers.map(|h| h.max_error_m).fold(0.0, f32::max)
}

/// Prints what is in a pack.
pub fn print(pack: &Pack, args: &PackArgs) {
    if args.json {
        say!("{}", info_json(&args.pack, pack));
    } else {
        print_text(&args.pack, pack);
    }
}

fn levels_json(pack: &Pack, partition: Partition, levels: &[LevelSummary]) -> Vec<Value> {
    std::iter::zip(0_u8.., levels)
        .map(|(level, s)| {
            let error = pack.info().level_error(partition, level);
            json!({
                "level": level,
                "spacing_deg": pack.info().grid.spacing_deg(level),
                "tiles": s.tiles,
                "bytes": s.bytes,
                "rms_error_m": error.map(|e| e.rms_m),
                "max_error_m": error.map(|e| e.max_m),
                "low_m": error.map(|e| e.low_m),
                "summit_low_m": error.map(|e| e.summit_low_m),
            })
        })
        .collect()
}

fn info_json(path: &Path, pack: &Pack) -> Value {
    let info = pack.info();
    let partitions: Vec<Value> = partitions(pack)
        .map(|partition| {
            json!({
                "partition": partition.name(),
                "levels": levels_json(pack, partition, &level_summaries(pack, partition)),
                "max_error_m": max_error_m(pack, partition),
            })
        })
        .collect();
    let geographic = level_summaries(pack, Partition::Geographic);
    let all: u64 = geographic.iter().map(|l| l.bytes).sum();
    let sources: Vec<Value> = pack
        .sources()
        .iter()
        .map(|s| json!({"name": s.name, "bounds": bounds_json(&s.rect.bounds(info.grid))}))
        .collect();
    json!({
        "pack": path.display().to_string(),
        "version": info.version,
        "posts_per_degree": info.grid.posts_per_degree,
        "levels": levels_json(pack, Partition::Geographic, &geographic),
        "partitions": partitions,
        "bounds": bounds_json(&info.bounds),
        "unit_m": info.unit_m,
        "base_m": info.base_m,
        "height_min_m": info.height_min_m,
        "height_max_m": info.height_max_m,
        "posts": info.posts,
        "void_posts": info.void_posts,
        "water_posts": info.water_posts,
        "tiles": info.tiles,
        "bytes": info.bytes,
        "bits_per_sample": bits_per_sample(geographic.first().map_or(0, |l| l.bytes), info.posts),
        "bits_per_sample_all_levels": bits_per_sample(all, info.posts),
        "max_error_m": max_error_m(pack, Partition::Geographic),
        "sources": sources,
    })
}

fn bounds_json(b: &Bounds) -> Value {
    json!({"south": b.south_deg, "west": b.west_deg, "north": b.north_deg, "east": b.east_deg})
}

fn print_text(path: &Path, pack: &Pack) {
    let info = pack.info();
    let b = &info.bounds;
    let geographic = level_summaries(pack, Partition::Geographic);
    let all: u64 = geographic.iter().map(|l| l.bytes).sum();
    say!("{}: terrain pack, format {}", path.display(), info.version);
    say!(
        "bounds      {} to {} N, {} to {} E",
        b.south_deg,
        b.north_deg,
        b.west_deg,
        b.east_deg
    );
    say!(
        "heights     {} to {} m above EGM96, in steps of {} m, at most {} m from their source",
        info.height_min_m,
        info.height_max_m,
        info.unit_m,
        max_error_m(pack, Partition::Geographic)
    );
    say!(
        "posts       {} ({} a degree), of these {} void and {} water",
        info.posts,
        info.grid.posts_per_degree,
        info.void_posts,
        info.water_posts
    );
    say!(
        "bytes       {} in {} tiles; {:.2} bits a sample on the finest level, {:.2} with all levels",
        info.bytes,
        info.tiles,
        bits_per_sample(geographic.first().map_or(0, |l| l.bytes), info.posts),
        bits_per_sample(all, info.posts),
    );
    for partition in partitions(pack) {
        if partition != Partition::Geographic {
            say!(
                "{}   at most {} m from the sources",
                partition.name(),
                max_error_m(pack, partition)
            );
        }
        print_levels(pack, partition);
    }
    say!(
        "RMS, most and low: the level's surface against the finest posts, metres; low: below any of them; summit: below one"
    );
    for source in pack.sources() {
        let b = source.rect.bounds(info.grid);
        say!(
            "source      {}: {} to {} N, {} to {} E",
            source.name,
            b.south_deg,
            b.north_deg,
            b.west_deg,
            b.east_deg
        );
    }
}

fn print_levels(pack: &Pack, partition: Partition) {
    say!("level  spacing/deg  tiles      bytes  RMS/m  most/m  low/m  summit/m");
    for (level, s) in std::iter::zip(0_u8.., level_summaries(pack, partition)) {
        let errors = match pack.info().level_error(partition, level) {
            Some(e) => format!(
                "{:5.1}  {:6.0}  {:5.0}  {:8.0}",
                e.rms_m, e.max_m, e.low_m, e.summit_low_m
            ),
            None => "    -       -      -         -".to_owned(),
        };
        say!(
            "{level:5}  {:11.7}  {:5}  {:9}  {errors}",
            pack.info().grid.spacing_deg(level),
            s.tiles,
            s.bytes
        );
    }
}
