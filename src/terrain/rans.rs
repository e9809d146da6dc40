//! The entropy coder of the pyramid ([`crate::terrain::pyramid`]): residuals to bytes and back. Pure.
//!
//! Asymmetric numeral systems in their range form (Duda 2013, arXiv:1311.2540, section 3.2): a state x of 32 bits, 2^16 at
//! least between symbols, words of 16 bits, probabilities in 4096ths; four states take turns, so that a processor has four
//! chains to follow instead of one.
//!
//! A residual q becomes u = 2q for q >= 0 and -2q - 1 for q < 0. u below 64 is a token of its own; above, octave and half
//! octave are the token (64 to 85) and the lower bits follow as they are. Token 86 says that no token of the distribution
//! fits and that u follows in 17 bits.
//!
//! Distributions are not stored. There are 64 of them, one for each of 64 scales a factor of 2^(2/9) apart; a context names
//! its scale in one byte. Each is a mean of two exponentials of |q|, the wider one for what surprises: 4/5 of scale b, 1/5 of
//! 2.2 b, with b = 0.08 2^(2k/9). They are computed with the four basic operations of IEEE 754 alone, which give the same
//! bits on every machine, so that every machine reads what another wrote.

use std::sync::LazyLock;

/// Residuals whose scale is chosen together are of one context; there are this many.
pub(crate) const CONTEXTS: usize = 20;
/// Residuals that are coded at a time.
pub(crate) const ROW: usize = 64;

const PROBABILITY_BITS: u32 = 12;
const SLOTS: usize = 1 << PROBABILITY_BITS;
const SCALES: usize = 64;
/// u below this is its own token.
const DIRECT: u32 = 64;
const DIRECT_BITS: u32 = DIRECT.ilog2();
/// Bits of the largest u: residuals of 16-bit heights are 65 535 at most either way.
const U_BITS: u32 = 17;
#[expect(clippy::cast_possible_truncation, reason = "86")]
const ESCAPE: u8 = (DIRECT + 2 * (U_BITS - DIRECT_BITS)) as u8;
const TOKENS: usize = ESCAPE as usize + 1;
/// A state is at least this between symbols.
const STATE_MIN: u32 = 1 << 16;
const STATES: usize = 4;

/// Words that all rows of a tile may take: 12 bits a symbol is the most, 4 states of two words besides.
pub(crate) const WORDS_MAX: usize = 1 << 14;
const _: () = assert!(
    crate::terrain::grid::TILE_AREA * 12 / 16 + 2 * STATES <= WORDS_MAX,
    "every tile's words fit"
);

/// The distributions, made once.
static TABLES: LazyLock<Tables> = LazyLock::new(Tables::new);

struct Tables {
    /// For each scale and slot: token, frequency and place of the slot within the token, in 7, 12 and 12 bits.
    slots: Vec<[u32; SLOTS]>,
    /// For each scale and token: frequency and first slot; frequency 0 where the token is not in the distribution.
    tokens: Vec<[(u16, u16); TOKENS]>,
    /// For each scale and token: its cost in 256ths of a bit, with the bits that follow it.
    costs: Vec<[u32; TOKENS]>,
}

impl Tables {
    fn new() -> Self {
        let mut all = Self {
            slots: vec![[0; SLOTS]; SCALES],
            tokens: vec![[(0, 0); TOKENS]; SCALES],
            costs: vec![[0; TOKENS]; SCALES],
        };
        let mut scale = SCALE_MIN;
        for k in 0..SCALES {
            let frequencies = frequencies(scale);
            let mut first = 0_u16;
            for (token, frequency) in frequencies.into_iter().enumerate() {
                all.tokens[k][token] = (frequency, first);
                for place in 0..frequency {
                    #[expect(clippy::cast_possible_truncation, reason = "87 tokens")]
                    let entry =
                        token as u32 | (u32::from(frequency) << 7) | (u32::from(place) << 19);
                    all.slots[k][usize::from(first + place)] = entry;
                }
                first += frequency;
            }
            for token in 0..TOKENS {
                all.costs[k][token] = cost(&frequencies, token);
            }
            scale *= SCALE_STEP;
        }
        all
    }
}

/// The smallest b.
const SCALE_MIN: f64 = 0.08;
/// 2^(2/9).
const SCALE_STEP: f64 = 1.166_529_039_576_116_5;

/// Cost of a token in 256ths of a bit; one that has no slots is said by the escape.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "some thousand 256ths"
)]
fn cost(frequencies: &[u16; TOKENS], token: usize) -> u32 {
    let of = |frequency: u16| {
        ((f64::from(PROBABILITY_BITS) - f64::from(frequency).log2()) * 256.0).round() as u32
    };
    match frequencies[token] {
        0 => of(frequencies[usize::from(ESCAPE)]) + U_BITS * 256,
        frequency => of(frequency) + extra_bits(token as u8) * 256,
    }
}

/// Frequencies of the tokens in 4096ths for a scale; they sum to 4096, and the escape has at least one.
fn frequencies(scale: f64) -> [u16; TOKENS] {
    /// Share of |q| that is at least `x`, which is not negative.
    fn beyond(x: f64, scale: f64) -> f64 {
        0.8 * exp_minus(x / scale) + 0.2 * exp_minus(x / (2.2 * scale))
    }
    let mut all = [0_u16; TOKENS];
    let (mut left, mut most) = (4095_i32, 0);
    for token in 0..usize::from(ESCAPE) {
        let (low, high) = magnitudes(token);
        let share = if token == 0 {
            1.0 - beyond(0.5, scale)
        } else {
            beyond(low - 0.5, scale) - beyond(high + 0.5, scale)
        };
        // Below 64 a token is one sign of a magnitude, above it is both.
        let share = if token == 0 || token >= DIRECT as usize {
            share
        } else {
            share / 2.0
        };
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a share of 4096"
        )]
        {
            all[token] = (share * 4096.0 + 0.5) as u16;
        }
        left -= i32::from(all[token]);
        if all[token] > all[most] {
            most = token;
        }
    }
    all[usize::from(ESCAPE)] = 1;
    // What rounding left over, either way, goes to the most frequent.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "far fewer than the most frequent has"
    )]
    {
        all[most] = (i32::from(all[most]) + left) as u16;
    }
    all
}

/// The smallest and the largest |q| of a token other than the escape.
fn magnitudes(token: usize) -> (f64, f64) {
    #[expect(clippy::cast_possible_truncation, reason = "86 tokens")]
    let token = token as u32;
    if token < DIRECT {
        let magnitude = f64::from(token.div_ceil(2));
        return (magnitude, magnitude);
    }
    let octave = DIRECT_BITS + (token - DIRECT) / 2;
    let half = 1 << (octave - 1);
    let low = (1 << octave) + (token - DIRECT) % 2 * half;
    (f64::from(low / 2), f64::from((low + half - 1) / 2))
}

/// e^-x for x >= 0 by the four basic operations: the series of e^(-x / 2^n) for a small argument, squared n times.
fn exp_minus(x: f64) -> f64 {
    if x > 700.0 {
        return 0.0;
    }
    let (mut small, mut squarings) = (x, 0);
    while small > 0.031_25 {
        small *= 0.5;
        squarings += 1;
    }
    let mut sum = 1.0;
    for n in (1..=9).rev() {
        sum = 1.0 - small / f64::from(n) * sum;
    }
    for _ in 0..squarings {
        sum *= sum;
    }
    sum
}

/// Bits that follow a token.
fn extra_bits(token: u8) -> u32 {
    match u32::from(token) {
        t if t < DIRECT => 0,
        t if t < u32::from(ESCAPE) => DIRECT_BITS - 1 + (t - DIRECT) / 2,
        _ => U_BITS,
    }
}

/// The token of u, below 2^17.
#[expect(clippy::cast_possible_truncation, reason = "87 tokens")]
const fn token_of(u: u32) -> u8 {
    if u < DIRECT {
        return u as u8;
    }
    let octave = u.ilog2();
    (DIRECT + 2 * (octave - DIRECT_BITS) + ((u >> (octave - 1)) & 1)) as u8
}

const fn zigzag(q: i32) -> u32 {
    ((q << 1) ^ (q >> 31)).cast_unsigned()
}

const fn unzigzag(u: u32) -> i32 {
    ((u >> 1) ^ (u & 1).wrapping_neg()).cast_signed()
}

/// Takes residuals and writes them at the end, when their statistics are known.
#[derive(Debug, Default)]
pub(crate) struct Writer {
    symbols: Vec<(u8, u32)>,
    words: Vec<u16>,
}

impl Writer {
    /// Forgets everything.
    pub(crate) fn clear(&mut self) {
        self.symbols.clear();
    }

    /// Takes a row; contexts are below [`CONTEXTS`], residuals within 65 535.
    pub(crate) fn row(&mut self, contexts: &[u8; ROW], residuals: &[i32; ROW]) {
        let symbols = contexts.iter().zip(residuals);
        self.symbols.extend(symbols.map(|(c, q)| (*c, zigzag(*q))));
    }

    /// Appends: the scale of each context; the number of words, u16; the words; the bits that follow tokens, from the lowest,
    /// up to the end.
    pub(crate) fn write(&mut self, out: &mut Vec<u8>) {
        let scales = self.scales();
        out.extend(scales);
        let mut bits = BitWriter::default();
        for (context, u) in &self.symbols {
            let (token, _) = coded(&scales, *context, *u);
            let count = extra_bits(token);
            bits.put(u & ((1 << count) - 1), count);
        }
        self.words.clear();
        let mut states = [STATE_MIN; STATES];
        for (n, (context, u)) in self.symbols.iter().enumerate().rev() {
            let (_, (frequency, first)) = coded(&scales, *context, *u);
            let (frequency, first) = (u32::from(frequency), u32::from(first));
            let state = &mut states[n % STATES];
            if *state >= frequency << 20 {
                #[expect(clippy::cast_possible_truncation, reason = "its lower half")]
                self.words.push(*state as u16);
                *state >>= 16;
            }
            *state = ((*state / frequency) << PROBABILITY_BITS) + *state % frequency + first;
        }
        for state in states.iter().rev() {
            #[expect(clippy::cast_possible_truncation, reason = "both halves")]
            self.words.extend([*state as u16, (*state >> 16) as u16]);
        }
        let count = u16::try_from(self.words.len()).unwrap_or(u16::MAX);
        out.extend(count.to_le_bytes());
        for word in self.words.iter().rev() {
            out.extend(word.to_le_bytes());
        }
        bits.finish(out);
    }

    /// The scale that is cheapest for each context.
    fn scales(&self) -> [u8; CONTEXTS] {
        let mut counts = [[0_u32; TOKENS]; CONTEXTS];
        for (context, u) in &self.symbols {
            counts[usize::from(*context)][usize::from(token_of(*u))] += 1;
        }
        counts.map(|counts| {
            let price = |costs: &[u32; TOKENS]| -> u64 {
                let each = counts.iter().zip(costs);
                each.map(|(n, c)| u64::from(*n) * u64::from(*c)).sum()
            };
            let prices = TABLES.costs.iter().map(price);
            let best = prices.enumerate().min_by_key(|(_, price)| *price);
            best.map_or(0, |(scale, _)| u8::try_from(scale).unwrap_or(0))
        })
    }
}

/// The token that says u in a context, and its frequency and first slot.
fn coded(scales: &[u8; CONTEXTS], context: u8, u: u32) -> (u8, (u16, u16)) {
    let tokens = &TABLES.tokens[usize::from(scales[usize::from(context)])];
    let token = token_of(u);
    match tokens[usize::from(token)] {
        (0, _) => (ESCAPE, tokens[usize::from(ESCAPE)]),
        slots => (token, slots),
    }
}

#[derive(Default)]
struct BitWriter {
    bytes: Vec<u8>,
    held: u64,
    count: u32,
}

impl BitWriter {
    fn put(&mut self, bits: u32, count: u32) {
        self.held |= u64::from(bits) << self.count;
        self.count += count;
        while self.count >= 8 {
            #[expect(clippy::cast_possible_truncation, reason = "its lowest byte")]
            self.bytes.push(self.held as u8);
            self.held >>= 8;
            self.count -= 8;
        }
    }

    fn finish(mut self, out: &mut Vec<u8>) {
        self.put(0, (8 - self.count % 8) % 8);
        out.extend(self.bytes);
    }
}

/// Room for the words of a tile.
pub(crate) type Words = [u16; WORDS_MAX];

/// Reads rows of residuals. What is damaged gives some residuals or other, never a panic; [`Reader::is_whole`] tells.
pub(crate) struct Reader<'a> {
    scales: [&'static [u32; SLOTS]; 32],
    states: [u32; STATES],
    words: &'a Words,
    at: usize,
    end: usize,
    bits: &'a [u8],
    bit: usize,
}

impl<'a> Reader<'a> {
    /// Begins what [`Writer::write`] wrote; `words` is room. `None` where it cannot be that.
    pub(crate) fn new(bytes: &'a [u8], words: &'a mut Words) -> Option<Self> {
        let (scales, rest) = bytes.split_first_chunk::<CONTEXTS>()?;
        let (count, rest) = rest.split_first_chunk::<2>()?;
        let count = usize::from(u16::from_le_bytes(*count));
        let (stored, bits) = rest.split_at_checked(2 * count)?;
        if !(2 * STATES..=WORDS_MAX).contains(&count) {
            return None;
        }
        for (word, bytes) in words.iter_mut().zip(stored.chunks_exact(2)) {
            *word = u16::from_le_bytes([bytes[0], bytes[1]]);
        }
        let tables = &TABLES.slots;
        let mut chosen = [&tables[0]; 32];
        for (table, scale) in chosen.iter_mut().zip(scales) {
            *table = tables.get(usize::from(*scale))?;
        }
        let mut states = [0; STATES];
        for (state, pair) in states.iter_mut().zip(words.chunks_exact(2)) {
            *state = (u32::from(pair[0]) << 16) | u32::from(pair[1]);
        }
        Some(Self {
            scales: chosen,
            states,
            words,
            at: 2 * STATES,
            end: count,
            bits,
            bit: 0,
        })
    }

    /// The next row.
    #[inline]
    pub(crate) fn row(&mut self, contexts: &[u8; ROW], residuals: &mut [i32; ROW]) {
        let (mut states, mut at) = (self.states, self.at);
        for (contexts, residuals) in contexts
            .chunks_exact(STATES)
            .zip(residuals.chunks_exact_mut(STATES))
        {
            for ((state, context), residual) in states.iter_mut().zip(contexts).zip(residuals) {
                let slots = self.scales[usize::from(*context % 32)];
                let slot = slots[*state as usize % SLOTS];
                let next = ((slot >> 7) & 0xfff) * (*state >> PROBABILITY_BITS) + (slot >> 19);
                // Without a branch: whether a word is due cannot be foreseen.
                let word = u32::from(self.words[at % WORDS_MAX]);
                let is_due = next < STATE_MIN;
                *state = if is_due { (next << 16) | word } else { next };
                at += usize::from(is_due);
                let token = slot & 0x7f;
                let u = if token < DIRECT {
                    token
                } else {
                    self.longer(token as u8)
                };
                *residual = unzigzag(u);
            }
        }
        (self.states, self.at) = (states, at);
    }

    /// u from its token and the bits that follow it.
    fn longer(&mut self, token: u8) -> u32 {
        let count = extra_bits(token);
        let mut window = [0; 4];
        let from = self.bit / 8;
        for (byte, stored) in window.iter_mut().zip(self.bits.iter().skip(from)) {
            *byte = *stored;
        }
        let low = (u32::from_le_bytes(window) >> (self.bit % 8)) & ((1 << count) - 1);
        self.bit += count as usize;
        if token >= ESCAPE {
            return low;
        }
        let half = u32::from(token) - DIRECT;
        ((2 + half % 2) << count) | low
    }

    /// Whether all that was written has been read, and nothing else.
    pub(crate) fn is_whole(&self) -> bool {
        self.states == [STATE_MIN; STATES]
            && self.at == self.end
            && self.bit.div_ceil(8) == self.bits.len()
    }
}

/// Makes the distributions, so that reading does not have to.
pub(crate) fn prepare() {
    LazyLock::force(&TABLES);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn every_distribution_is_whole_and_every_token_means_its_residuals() {
        for (tokens, costs) in TABLES.tokens.iter().zip(&TABLES.costs) {
            let sum: u32 = tokens.iter().map(|t| u32::from(t.0)).sum();
            assert_eq!(sum, 4096, "all slots are given");
            assert!(tokens.iter().all(|t| t.0 < 4096), "12 bits hold each");
            assert!(tokens[usize::from(ESCAPE)].0 > 0, "there is always a way");
            assert!(
                costs.iter().all(|c| *c < 32 * 256),
                "no token is dearer than 29 bits"
            );
        }
        let mut last = 0;
        for u in 0..1 << U_BITS {
            let token = token_of(u);
            assert!(
                token == last || token == last + 1,
                "tokens follow each other at {u}"
            );
            last = token;
            let (low, high) = magnitudes(usize::from(token));
            let magnitude = f64::from(unzigzag(u).abs());
            assert!(
                (low..=high + 1.0).contains(&magnitude),
                "{u}: {low} to {high}"
            );
            assert_eq!(zigzag(unzigzag(u)), u, "{u}");
        }
        assert_eq!(last, ESCAPE - 1, "the last token before the escape is used");
    }

    #[test]
    fn the_exponential_is_right_to_the_last_bits() {
        for n in 0..2000 {
            let x = f64::from(n) * 0.037;
            let (own, of_std) = (exp_minus(x), (-x).exp());
            assert!(
                (own - of_std).abs() <= 1e-12 * of_std,
                "{x}: {own} and {of_std}"
            );
        }
    }

    /// A distribution is part of the format: these sums were computed once with 50 digits (Python's mpmath).
    #[test]
    fn a_scale_of_one_metre_has_the_shares_that_its_formula_says() {
        // Scale 16: b = 0.08 * 2^(32/9) = 0.9406. P(0) = 1 - 0.8 e^(-0.5/b) - 0.2 e^(-0.5/2.2b), times 4096, to the nearest
        // but for what rounding leaves over.
        let zero = f64::from(TABLES.tokens[16][0].0);
        let b = 0.08 * 2_f64.powf(32.0 / 9.0);
        let want = 4096.0 * (1.0 - 0.8 * (-0.5 / b).exp() - 0.2 * (-0.5 / (2.2 * b)).exp());
        assert!((zero - want).abs() < 16.0, "{zero} of {want}");
    }

    fn back(rows: &[([u8; ROW], [i32; ROW])]) -> usize {
        let mut writer = Writer::default();
        for (contexts, residuals) in rows {
            writer.row(contexts, residuals);
        }
        let mut bytes = Vec::new();
        writer.write(&mut bytes);
        let mut words = crate::terrain::codec::boxed::<u16, WORDS_MAX>(0);
        let mut reader = Reader::new(&bytes, &mut words).expect("own bytes");
        for (contexts, residuals) in rows {
            let mut read = [0; ROW];
            reader.row(contexts, &mut read);
            assert_eq!(&read, residuals, "residuals come back");
        }
        assert!(reader.is_whole(), "nothing is left over");
        bytes.len()
    }

    #[test]
    fn extremes_come_back_and_zeros_cost_next_to_nothing() {
        let zeros = vec![([3; ROW], [0; ROW]); 256];
        assert!(back(&zeros) < 80, "{} bytes for 16384 zeros", back(&zeros));
        let mut extremes = [65_535; ROW];
        for (n, e) in extremes.iter_mut().enumerate() {
            *e = [65_535, -65_535, 0, 32, -32, 33, 31][n % 7];
        }
        back(&vec![([0; ROW], extremes); 256]);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]

        #[test]
        fn any_residuals_come_back(
            seeds in prop::collection::vec((0..20_u8, prop_oneof![-3..4_i32, -200..200_i32, -65_535..65_536_i32]), ROW * 8),
        ) {
            let rows: Vec<([u8; ROW], [i32; ROW])> = seeds
                .chunks_exact(ROW)
                .map(|chunk| {
                    let (mut contexts, mut residuals) = ([0; ROW], [0; ROW]);
                    for (n, (context, residual)) in chunk.iter().enumerate() {
                        (contexts[n], residuals[n]) = (*context, *residual);
                    }
                    (contexts, residuals)
                })
                .collect();
            back(&rows);
        }

        #[test]
        fn any_bytes_are_survived(bytes in prop::collection::vec(any::<u8>(), 0..400), scale in 0..64_u8) {
            let mut bytes = bytes;
            for byte in bytes.iter_mut().take(CONTEXTS) {
                *byte = scale;
            }
            let mut words = crate::terrain::codec::boxed::<u16, WORDS_MAX>(0);
            if let Some(mut reader) = Reader::new(&bytes, &mut words) {
                for _ in 0..256 {
                    reader.row(&[1; ROW], &mut [0; ROW]);
                }
                let _ = reader.is_whole();
            }
        }
    }
}
