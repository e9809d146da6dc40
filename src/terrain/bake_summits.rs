//! Summits of the data: found among the finest posts, and kept for the levels that must not lose them.
//!
//! A *summit* is a measured post on land that no measured neighbour is higher than, and that is higher than one of them. The
//! posts of a void beside it do not count: where the top itself was never measured, the rim is the highest ground known.
//!
//! They are kept in a file without a name, 10 bytes each: mountains have some 250 in a tile.

use crate::terrain::bake_posts::{Patch, PatchPost, Posts, signed, whole};
use crate::terrain::bake_threads::{TURN, share};
use crate::terrain::codec::SurfaceKind;
use crate::terrain::grid::{Grid, TILE_AREA, TILE_SIDE, TileKey};
use crate::terrain::pack::Tiles;
use crate::terrain::partition::{CAP_LATITUDE_MIN_DEG, Partition};
use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io;
use std::os::unix::fs::FileExt;
use std::path::Path;

/// A summit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Summit {
    /// Level-0 posts east of its tile's south-west post; a fraction in a cap, whose posts stand elsewhere.
    pub(crate) x: f32,
    /// The same northwards.
    pub(crate) y: f32,
    /// Its height.
    pub(crate) quanta: u16,
}

const BYTES: usize = 10;

impl Summit {
    fn to_bytes(self) -> [u8; BYTES] {
        let mut bytes = [0; BYTES];
        bytes[..4].copy_from_slice(&self.x.to_le_bytes());
        bytes[4..8].copy_from_slice(&self.y.to_le_bytes());
        bytes[8..].copy_from_slice(&self.quanta.to_le_bytes());
        bytes
    }

    fn parse(bytes: &[u8]) -> Option<Self> {
        let (x, rest) = bytes.split_first_chunk()?;
        let (y, rest) = rest.split_first_chunk()?;
        let (quanta, _) = rest.split_first_chunk()?;
        Some(Self {
            x: f32::from_le_bytes(*x),
            y: f32::from_le_bytes(*y),
            quanta: u16::from_le_bytes(*quanta),
        })
    }

    /// Its place in level-0 posts of its partition.
    pub(crate) fn place(self, key: TileKey) -> (f64, f64) {
        (
            f64::from(key.west()) + f64::from(self.x),
            f64::from(key.south()) + f64::from(self.y),
        )
    }
}

/// The summits of a partition by level-0 tile.
#[derive(Debug)]
pub(crate) struct Summits {
    file: File,
    end: u64,
    /// Where those of a tile stand in the file, and how many bytes.
    places: BTreeMap<TileKey, Vec<(u64, usize)>>,
}

impl Summits {
    /// None yet. The file is made beside `target` and has no name from then on.
    pub(crate) fn create(target: &Path) -> io::Result<Self> {
        let mut name = std::ffi::OsString::from(".");
        name.push(target.file_name().unwrap_or_default());
        name.push(format!(".{}.summits", std::process::id()));
        let path = target.with_file_name(name);
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .create_new(true)
            .open(&path)?;
        fs::remove_file(&path)?;
        Ok(Self {
            file,
            end: 0,
            places: BTreeMap::new(),
        })
    }

    fn add(&mut self, key: TileKey, summits: &[Summit]) -> io::Result<()> {
        if summits.is_empty() {
            return Ok(());
        }
        let bytes: Vec<u8> = summits.iter().flat_map(|s| s.to_bytes()).collect();
        self.file.write_all_at(&bytes, self.end)?;
        let places = self.places.entry(key).or_default();
        places.push((self.end, bytes.len()));
        self.end += bytes.len() as u64;
        Ok(())
    }

    /// The tiles that have some.
    pub(crate) fn keys(&self) -> impl Iterator<Item = TileKey> + '_ {
        self.places.keys().copied()
    }

    /// The same from one tile to another, both inclusive.
    pub(crate) fn keys_between(
        &self,
        from: TileKey,
        to: TileKey,
    ) -> impl Iterator<Item = TileKey> + '_ {
        self.places.range(from..=to).map(|(key, _)| *key)
    }

    /// Adds the summits of a tile to `out`.
    pub(crate) fn read(&self, key: TileKey, out: &mut Vec<Summit>) -> io::Result<()> {
        for &(from, length) in self.places.get(&key).into_iter().flatten() {
            let mut bytes = vec![0; length];
            self.file.read_exact_at(&mut bytes, from)?;
            out.extend(bytes.chunks_exact(BYTES).filter_map(Summit::parse));
        }
        Ok(())
    }

    /// Finds the summits of geographic tiles.
    pub(crate) fn find(
        target: &Path,
        tiles: &Tiles,
        (grid, sea): (Grid, u16),
        jobs: usize,
    ) -> io::Result<Self> {
        let mut all = Self::create(target)?;
        let mut hands: Vec<(Posts<'_>, Patch)> = Vec::new();
        hands.resize_with(jobs.max(1), || {
            (Posts::new(tiles, grid, sea), Patch::default())
        });
        for entries in tiles.entries().chunks(TURN) {
            let found = share(&mut hands, entries, |(posts, patch), entry| {
                find_in(entry.key, posts, patch)
            });
            for (entry, found) in entries.iter().zip(found) {
                all.add(entry.key, &found?)?;
            }
        }
        Ok(all)
    }

    /// The same summits among the posts of a cap.
    pub(crate) fn turned(&self, target: &Path, grid: Grid, cap: Partition) -> io::Result<Self> {
        let mut all = Self::create(target)?;
        let mut summits = Vec::new();
        for key in self.keys() {
            summits.clear();
            self.read(key, &mut summits)?;
            let mut by_tile: BTreeMap<TileKey, Vec<Summit>> = BTreeMap::new();
            for summit in &summits {
                let Some(place) = cap_place(grid, cap, summit.place(key)) else {
                    continue;
                };
                let (i, j) = (whole(place.0.floor()), whole(place.1.floor()));
                let key = TileKey::of_post(cap, 0, i, j);
                by_tile.entry(key).or_default().push(Summit {
                    x: within(place.0 - f64::from(key.west())),
                    y: within(place.1 - f64::from(key.south())),
                    quanta: summit.quanta,
                });
            }
            for (key, summits) in by_tile {
                all.add(key, &summits)?;
            }
        }
        Ok(all)
    }
}

/// Where a place in geographic posts lies among a cap's; `None` if the cap does not reach so far.
pub(crate) fn cap_place(grid: Grid, cap: Partition, (x, y): (f64, f64)) -> Option<(f64, f64)> {
    let per_degree = f64::from(grid.posts_per_degree);
    let latitude_deg = y / per_degree;
    let from_equator_deg = if cap == Partition::South {
        -latitude_deg
    } else {
        latitude_deg
    };
    if from_equator_deg < CAP_LATITUDE_MIN_DEG {
        return None;
    }
    let (v, u) = cap.from_geodetic(x / per_degree, latitude_deg);
    Some((v * per_degree, u * per_degree))
}

/// A place in a tile.
#[expect(clippy::cast_possible_truncation, reason = "to 1/65536 of a post")]
fn within(v: f64) -> f32 {
    v as f32
}

/// The summits of a tile.
fn find_in(key: TileKey, posts: &mut Posts<'_>, patch: &mut Patch) -> io::Result<Vec<Summit>> {
    let side = TILE_SIDE.cast_unsigned() as usize;
    let width = side + 2;
    posts.patch(
        (key.partition, key.level),
        (key.west() - 1, key.south() - 1),
        (width, width),
        patch,
    )?;
    let mut found = Vec::new();
    for at in 0..TILE_AREA {
        let (x, y) = (at % side, at / side);
        // A tile may reach beyond the date line, where its posts belong to another.
        let own = (y + 1) * width + x + 1;
        let (i, _) = patch.place(own);
        if let Some(post) = patch.posts[own]
            && posts.names(i)
            && is_summit(post, &patch.posts, own, width)
        {
            found.push(Summit {
                x: within(f64::from(signed(x))),
                y: within(f64::from(signed(y))),
                quanta: post.quanta,
            });
        }
    }
    Ok(found)
}

fn is_summit(post: PatchPost, posts: &[Option<PatchPost>], at: usize, width: usize) -> bool {
    if post.kind != SurfaceKind::Land {
        return false;
    }
    let mut over = false;
    for row in [at - width, at, at + width] {
        for neighbour in posts[row - 1..=row + 1].iter().flatten() {
            if neighbour.kind == SurfaceKind::Void {
                continue;
            }
            if neighbour.quanta > post.quanta {
                return false;
            }
            over |= neighbour.quanta < post.quanta;
        }
    }
    over
}
