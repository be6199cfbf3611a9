//! The polynomial through the samples of a part, and its derivatives: sums of the samples, each with a weight that depends only on
//! where the samples are.

use core::f64::consts::PI;
use std::sync::LazyLock;

/// Samples of a part.
pub(super) const NODES: usize = 9;

/// Points at which the derivatives are known: the samples and one between each two of them.
pub(super) const POINTS: usize = 2 * NODES - 1;

/// Shares of a part at which it is sampled, from 0 to 1.
pub(super) static SHARES: LazyLock<[f64; NODES]> =
    LazyLock::new(|| core::array::from_fn(|node| (1.0 - chebyshev_point(node, NODES)) / 2.0));

/// Shares of a part at which its derivatives are known, from 0 to 1.
pub(super) static POINT_SHARES: LazyLock<[f64; POINTS]> =
    LazyLock::new(|| core::array::from_fn(|point| (1.0 - chebyshev_point(point, POINTS)) / 2.0));

/// Where a point is among [`AtPoints`].
pub(super) const fn place_of(point: usize) -> usize {
    if point < HALF_POINTS { point } else { LANES + POINTS - 1 - point }
}

/// By order: the first, second and third derivative.
pub(super) type ByOrder<T> = [T; 3];

/// One value for each point, in the order in which they are computed. A point and its mirror image about the middle of
/// the part are computed together: the points from the start to the middle come first, then those from the end back to
/// the middle. Those in the middle come twice, which fills the processor's vector registers.
pub(super) type AtPoints = [f64; PLACES];

/// Number of these values.
pub(super) const PLACES: usize = 2 * LANES;
const _: () = assert!(PLACES.is_multiple_of(4), "they are worked on four at a time");

/// Samples as what is alike before and after the middle of the part, and what is opposite. The points lie evenly about
/// the middle too, so each half of the samples counts for a point and for its mirror image at once.
pub(super) struct Halves {
    even: [f64; HALF],
    odd: [f64; HALF],
    middle: f64,
}

/// Samples before the middle one.
const HALF: usize = NODES / 2;

/// Points up to the middle one.
const HALF_POINTS: usize = POINTS.div_ceil(2);

/// A place for each of them, and one more: an even number is worked on two at a time.
const LANES: usize = HALF_POINTS.next_multiple_of(2);

impl Halves {
    pub(super) fn of(samples: &[f64; NODES]) -> Self {
        let mirrored = |node: usize| samples[NODES - 1 - node];
        Self {
            even: core::array::from_fn(|node| samples[node] + mirrored(node)),
            odd: core::array::from_fn(|node| samples[node] - mirrored(node)),
            middle: samples[HALF],
        }
    }

    /// Takes two polynomials with these factors, an even and an odd one, away.
    pub(super) fn take_away(&mut self, pair: &Self, [even_factor, odd_factor]: [f64; 2]) {
        for node in 0..HALF {
            self.even[node] -= even_factor * pair.even[node];
            self.odd[node] -= odd_factor * pair.odd[node];
        }
        self.middle -= even_factor * pair.middle;
    }
}

/// What each sample counts for so many values, as [`Halves`] have the samples: for the even ones of them and the
/// middle one, and for the odd ones.
pub(super) struct Weights<const N: usize> {
    even: [[f64; N]; HALF],
    middle: [f64; N],
    odd: [[f64; N]; HALF],
}

impl<const N: usize> Weights<N> {
    /// From the weights of a sample for the even and for the odd part of each value.
    fn of(even: impl Fn(usize, usize) -> f64, odd: impl Fn(usize, usize) -> f64) -> Self {
        let mirrored = |node: usize| NODES - 1 - node;
        Self {
            even: core::array::from_fn(|node| {
                core::array::from_fn(|value| (even(value, node) + even(value, mirrored(node))) / 2.0)
            }),
            middle: core::array::from_fn(|value| even(value, HALF)),
            odd: core::array::from_fn(|node| {
                core::array::from_fn(|value| (odd(value, node) - odd(value, mirrored(node))) / 2.0)
            }),
        }
    }

    /// What the even samples give, and what the odd ones give.
    #[inline]
    pub(super) fn apply(&self, samples: &Halves) -> [[f64; N]; 2] {
        let middle = self.middle.map(|weight| weight * samples.middle);
        [weighted(middle, &self.even, &samples.even), weighted([0.0; N], &self.odd, &samples.odd)]
    }
}

/// Adds samples to sums, each by its weights. One half at a time, so that its sums stay in registers; called as a function
/// they do not, and the compiler's choice depends on what else the crate has.
#[inline(always)]
fn weighted<const N: usize>(
    mut sums: [f64; N],
    weights: &[[f64; N]; HALF],
    samples: &[f64; HALF],
) -> [f64; N] {
    for (row, sample) in weights.iter().zip(samples) {
        for (sum, weight) in sums.iter_mut().zip(row) {
            *sum += weight * sample;
        }
    }
    sums
}

/// From samples to what is found at the points.
pub(super) struct Operator {
    /// To the points up to the middle.
    weights: Weights<LANES>,
    /// What is even in the samples comes out opposite at the mirror image of a point, as a slope does.
    turns: bool,
}

impl Operator {
    /// From the weight of a sample at a point.
    fn of(turns: bool, weight: impl Fn(usize, usize) -> f64) -> Self {
        Self { weights: Weights::of(&weight, &weight), turns }
    }

    /// What it finds, times `scale`.
    pub(super) fn apply(&self, samples: &Halves, scale: f64, found: &mut AtPoints) {
        let [even, odd] = self.weights.apply(samples);
        let (kept, turned) = if self.turns { (odd, even) } else { (even, odd) };
        let (points, mirrored) = found.split_at_mut(LANES);
        for lane in 0..LANES {
            points[lane] = (kept[lane] + turned[lane]) * scale;
            mirrored[lane] = (kept[lane] - turned[lane]) * scale;
        }
    }
}

pub(super) struct Operators {
    pub(super) values: Operator,
    pub(super) derivatives: ByOrder<Operator>,
    /// The polynomial's last six factors in the order of their degrees: the even ones from the even samples.
    pub(super) factors: Weights<3>,
    /// The Chebyshev polynomials of these degrees, two by two, as [`Halves`] of their values at the samples.
    pub(super) pairs: [Halves; 3],
    /// From each point to the next one, as shares of the part.
    pub(super) steps: [f64; POINTS - 1],
    /// The longest way from one sample to the next one, as a share of the part.
    pub(super) longest_step: f64,
    /// The derivatives at the end of the next but one Chebyshev polynomial.
    pub(super) ends: ByOrder<f64>,
}

pub(super) static OPERATORS: LazyLock<Operators> = LazyLock::new(|| {
    let degree = NODES - 1;
    let half = |index: usize| if index == 0 || index == degree { 0.5 } else { 1.0 };
    // Over the shares, the part begins at the far end of the Chebyshev points.
    let factor = |order: usize, node: usize| {
        let angle = PI * (order * (degree - node)) as f64 / degree as f64;
        2.0 / degree as f64 * half(order) * half(node) * libm::cos(angle)
    };
    let operator = |order: usize| {
        Operator::of(order % 2 == 1, |point, node| {
            let x = -chebyshev_point(point, POINTS);
            (0..NODES).map(|polynomial| polynomial_at(polynomial, x)[order] * factor(polynomial, node)).sum()
        })
    };
    let place = |point| (1.0 - chebyshev_point(point, POINTS)) / 2.0;
    let [_, ends @ ..] = polynomial_at(NODES + 1, 1.0);
    Operators {
        values: operator(0),
        derivatives: [operator(1), operator(2), operator(3)],
        factors: Weights::of(
            |pair, node| factor(NODES - 5 + 2 * pair, node),
            |pair, node| factor(NODES - 6 + 2 * pair, node),
        ),
        pairs: core::array::from_fn(|pair| {
            let [even, odd] = [NODES - 5, NODES - 6].map(|least| {
                core::array::from_fn(|node| polynomial_at(least + 2 * pair, -chebyshev_point(node, NODES))[0])
            });
            Halves { odd: Halves::of(&odd).odd, ..Halves::of(&even) }
        }),
        steps: core::array::from_fn(|point| place(point + 1) - place(point)),
        longest_step: SHARES.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max),
        ends,
    }
});

pub(super) fn chebyshev_point(index: usize, points: usize) -> f64 {
    libm::cos(PI * index as f64 / (points - 1) as f64)
}

/// A Chebyshev polynomial and its derivatives by the share, at `x` within −1…1, by its recurrence.
fn polynomial_at(degree: usize, x: f64) -> [f64; 4] {
    // Value and derivatives of the polynomials of degree 0 and 1.
    let (mut before, mut now) = ([1.0, 0.0, 0.0, 0.0], [x, 1.0, 0.0, 0.0]);
    if degree == 0 {
        now = before;
    }
    for _ in 1..degree {
        let next = core::array::from_fn(|order| {
            let below = if order == 0 { 0.0 } else { 2.0 * order as f64 * now[order - 1] };
            2.0 * x * now[order] + below - before[order]
        });
        (before, now) = (now, next);
    }
    // x runs twice as fast as the share.
    [now[0], 2.0 * now[1], 4.0 * now[2], 8.0 * now[3]]
}
