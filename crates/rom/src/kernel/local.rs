//! A basis of local modes: as few rows as a group of nodes needs, each as wide as an accepted error lets it be.
//!
//! A group is [`GROUP_TILES`] tiles. Rows of a field that are added up in a row (mean and modes; what moves the rest shape; the rest shape) are
//! one list. In every group a list has rows of its own ([`local_modes`](super::local_modes)) in f32, i16, i8 (see
//! [`budget`](super::budget)), and a matrix that makes their coefficients from those of the plan's rows, once for all its tiles:
//!
//! ```text
//! transforms   by group and list: for 16 of its own rows at a time, 16 f32 a row of the plan
//! counts       by group and list: own rows in f32, i16, i8
//! tiles        by group, tile and list: own rows in f32 (256 bytes), then i16 two at a time, then i8 four at a time (256 each)
//! ```
//! Two rows of i16, or four of i8 (128 more than their number), lie node by node, a 32-bit word each: products with as many small whole factors
//! and their sum are one instruction. For that the sweep makes whole numbers of a list's coefficients ([`whole`](super::whole)): of i8 in
//! 16 bits of the largest, a hundredth of what the rows are rounded by, of i16 in 23 bits of their sum. Steps are in the matrix.

use std::ops::Range;

use super::TILE_NODES;
use super::budget::{self, Budget, Component, F32_ROUNDING, I8_MAX, Width};
use super::lanes::{BYTE_ZERO, word};
use super::local_modes::{Columns, GroupRows, add_times, as_they_are, energy, local_modes, square_root};
use super::pages::{LINE, Line, Lines};
use super::plan::{Op, Plan};
use super::spec::{BasisError, Shortfall, Spec};
use super::tiles::{I16_MAX, Row, RowOf, gather, rows};

/// Rows of a list in f32, i16 and i8.
pub(super) type Counts = [u16; 3];

/// Tiles that share local modes: more need more rows, fewer make the matrices weigh more.
pub(super) const GROUP_TILES: usize = 32;
/// Nodes of a group.
const GROUP_NODES: usize = GROUP_TILES * TILE_NODES;
/// Own rows whose coefficients are made at once: a cache line of f32.
pub(super) const AT_ONCE: usize = LINE / size_of::<f32>();
/// Share of the accepted square error that is left out before steps are chosen.
const LEFT_OUT: f64 = 0.1;

/// The tiles of such a basis and what is needed to read them.
#[derive(Debug, Clone)]
pub(super) struct Local {
    tiles: Lines,
    transforms: Vec<Line>,
    counts: Vec<Counts>,
    /// By list: its rows in the plan.
    lists: Vec<usize>,
    /// By row of the plan: the most that storage changes a value of it.
    largest_errors: Vec<f64>,
}

/// The rows of a plan by list and group: what bases of one plan within different budgets have in common.
#[derive(Debug)]
pub(super) struct Gathered {
    /// By affine field.
    lists: Vec<Vec<ListRows>>,
}

/// A list of rows.
#[derive(Debug)]
struct ListRows {
    /// Of the rows of its field.
    of_field: Range<usize>,
    /// The field's first row in the plan.
    first: usize,
    groups: Vec<GroupRows>,
}

impl Gathered {
    /// 8 bytes an entry, and as much again where local modes are looked for.
    pub fn new(spec: &Spec<'_>, plan: &Plan) -> Result<Self, BasisError> {
        let (mut lists, mut first) = (Vec::new(), 0);
        for op in &plan.ops {
            let of_field = rows(spec, op);
            check_finite(spec, op.field, &of_field)?;
            let groups = 0..spec.output_nodes().div_ceil(GROUP_NODES);
            let of_list = |list: Range<usize>| {
                let of_group = |group| GroupRows::new(columns(spec, &of_field[list.clone()], group));
                ListRows { groups: groups.clone().map(of_group).collect(), of_field: list, first }
            };
            lists.push(op.lists().map(of_list).collect());
            first += of_field.len();
        }
        Ok(Self { lists })
    }
}

/// A list and its components by group.
struct List<'a> {
    rows: &'a ListRows,
    groups: Vec<Vec<Component>>,
    step: f64,
}

impl Local {
    /// Finds the components of every list and stores them within the budget.
    pub fn build(plan: &Plan, gathered: &Gathered, budget: &Budget<'_>) -> Result<Self, BasisError> {
        let found = budget.typical.iter().map(Vec::len).min().unwrap_or(0);
        if budget.typical.is_empty() || found < plan.coefficients {
            return Err(BasisError::Typical { found, expected: plan.coefficients });
        }
        let (mut lists, mut short) = (Vec::new(), Vec::new());
        for (op, rows) in plan.ops.iter().zip(&gathered.lists) {
            match lists_of(op, rows, plan.nodes, budget) {
                Ok(of_op) => lists.extend(of_op),
                Err(shortfall) => short.push(shortfall),
            }
        }
        if short.is_empty() { Ok(Self::store(plan, &lists)) } else { Err(BasisError::Budget(short)) }
    }

    fn store(plan: &Plan, lists: &[List<'_>]) -> Self {
        let mut local = Self {
            tiles: Lines::zeroed(0),
            transforms: Vec::new(),
            counts: Vec::new(),
            lists: lists.iter().map(|list| list.rows.of_field.len()).collect(),
            largest_errors: vec![0.0; plan.rows],
        };
        let mut tiles = Vec::new();
        for group in 0..plan.tiles().div_ceil(GROUP_TILES) {
            let mut stored: Vec<Vec<Stored<'_>>> = Vec::new();
            for list in lists {
                let mut of_list: Vec<_> = list.groups[group]
                    .iter()
                    .filter_map(|component| Stored::new(component, list.step))
                    .collect();
                of_list.sort_by_key(|own| own.width); // stable: the largest first in each
                local.push_transform(&of_list, list.rows.of_field.len());
                stored.push(of_list);
            }
            let of_group = group * GROUP_TILES..plan.tiles().min((group + 1) * GROUP_TILES);
            for tile in 0..of_group.len() {
                stored.iter().for_each(|of_list| push_tile(&mut tiles, of_list, tile));
            }
            for (list, stored) in lists.iter().zip(&stored) {
                local.note_errors(list.rows, group, stored);
            }
        }
        local.tiles = Lines::from(&tiles[..]);
        local
    }

    fn push_transform(&mut self, stored: &[Stored<'_>], plan_rows: usize) {
        self.counts
            .push(Width::ALL.map(|width| stored.iter().filter(|own| own.width == width).count() as u16));
        for own in stored.chunks(AT_ONCE) {
            for row in 0..plan_rows {
                let entry =
                    |k: usize| own.get(k).map_or(0.0, |own| own.component.of_rows[row] * own.factor());
                push_words(
                    &mut self.transforms,
                    &std::array::from_fn::<_, AT_ONCE, _>(|k| (entry(k) as f32).to_bits()),
                );
            }
        }
    }

    /// What becomes of each row of the list in this group, and how far that is from what it was.
    fn note_errors(&mut self, list: &ListRows, group: usize, stored: &[Stored<'_>]) {
        let columns = &list.groups[group].rows;
        let read: Vec<Vec<f64>> = stored.iter().map(|own| own.read(columns.length)).collect();
        for (at, row) in list.of_field.clone().enumerate() {
            let mut errors: Vec<f64> = columns.of(at).iter().map(|value| -value).collect();
            for (own, read) in stored.iter().zip(&read) {
                add_times(&mut errors, read, own.component.of_rows[at]);
            }
            let most = &mut self.largest_errors[list.first + row];
            *most = errors.iter().fold(*most, |most, error| most.max(error.abs()));
        }
    }

    /// The most that storage changes a value of row `row` of the plan.
    pub fn largest_error(&self, row: usize) -> f64 {
        self.largest_errors[row]
    }

    /// Rows of the plan by list.
    pub fn lists(&self) -> &[usize] {
        &self.lists
    }

    /// The rows of all tiles.
    pub fn tiles(&self) -> &[Line] {
        &self.tiles
    }

    /// What makes their coefficients, and how many rows there are.
    pub fn groups(&self) -> (&[Line], &[Counts]) {
        (&self.transforms, &self.counts)
    }

    /// Rows of tiles by width: f32, i16, i8.
    pub fn stored(&self, plan: &Plan) -> [usize; 3] {
        let mut sums = [0; 3];
        for (group, counts) in self.counts.chunks_exact(self.lists.len().max(1)).enumerate() {
            let tiles = GROUP_TILES.min(plan.tiles() - group * GROUP_TILES);
            for counts in counts {
                sums.iter_mut().zip(counts).for_each(|(sum, count)| *sum += tiles * usize::from(*count));
            }
        }
        sums
    }
}

/// The lists of a field, all with one step; in f32 as they are, or what is short, where no step keeps what is accepted.
fn lists_of<'a>(
    op: &Op,
    rows: &'a [ListRows],
    nodes: usize,
    budget: &Budget<'_>,
) -> Result<Vec<List<'a>>, Shortfall> {
    let accepted = budget.accepted.get(op.field).copied().unwrap_or(0.0).max(0.0);
    let coefficients: Vec<Option<usize>> = op.coefficients_of_rows().collect();
    let root = |list: &Range<usize>| {
        let of_list = &coefficients[list.clone()];
        let typical = |vector: &Vec<f64>| of_list.iter().map(|of| of.map_or(1.0, |of| vector[of])).collect();
        square_root(&budget.typical.iter().map(typical).collect::<Vec<_>>(), list.len())
    };
    let roots: Vec<Columns> = rows.iter().map(|list| root(&list.of_field)).collect();
    // All lists, each group's components made by number of the list, rows and root.
    let each = |make: &mut dyn FnMut(usize, &GroupRows, &Columns) -> Vec<Component>| -> Vec<List<'a>> {
        let of_lists = rows.iter().zip(&roots).enumerate().map(|(at, (rows, root))| {
            let groups = rows.groups.iter().map(|group| make(at, group, root)).collect();
            List { rows, groups, step: 0.0 }
        });
        of_lists.collect()
    };

    let nodes = nodes as f64;
    let of_list = |(list, root): (&ListRows, &Columns)| -> f64 {
        list.groups.iter().map(|group| energy(&group.rows, root)).sum()
    };
    let energy: f64 = rows.iter().zip(&roots).map(of_list).sum();
    let least = (energy * F32_ROUNDING / nodes).sqrt();
    if accepted >= least {
        let mut left_out = 0.0;
        let mut local = each(&mut |at, group, root| {
            if at > 0 {
                return as_they_are(&group.rows, root);
            }
            let tolerance = LEFT_OUT * accepted * accepted * group.rows.length as f64;
            let (modes, rest) = local_modes(group, root, tolerance);
            left_out += rest;
            modes
        });
        if let Some(step) = budget::step(components(&local), [accepted, nodes, left_out]) {
            local.iter_mut().for_each(|list| list.step = step);
            return Ok(local);
        }
    } else if !budget.or_f32 {
        return Err(Shortfall { field: op.field, accepted, least });
    }
    Ok(each(&mut |_, group, root| as_they_are(&group.rows, root))) // a step of 0: all in f32
}

fn components<'a>(lists: &'a [List<'_>]) -> impl Iterator<Item = &'a Component> {
    lists.iter().flat_map(|list| list.groups.iter().flatten())
}

/// Rows over the nodes of a group.
fn columns(spec: &Spec<'_>, rows: &[RowOf<'_>], group: usize) -> Columns {
    let nodes = group * GROUP_NODES..spec.output_nodes().min((group + 1) * GROUP_NODES);
    let of_row = |row| nodes.clone().map(move |node| RowOf::value(row, spec.source_node(node)));
    Columns { length: nodes.len(), values: rows.iter().flat_map(of_row).collect() }
}

fn check_finite(spec: &Spec<'_>, field: usize, rows: &[RowOf<'_>]) -> Result<(), BasisError> {
    let tiles = 0..spec.output_nodes().div_ceil(TILE_NODES);
    rows.iter().try_for_each(|row| {
        tiles.clone().try_for_each(|tile| gather(spec, field, tile, &|node| row.value(node)).map(drop))
    })
}

/// A component as it is stored.
struct Stored<'a> {
    component: &'a Component,
    width: Width,
    step: f64,
}

impl<'a> Stored<'a> {
    fn new(component: &'a Component, step: f64) -> Option<Self> {
        component.stored(step).map(|(width, step)| Self { component, width, step })
    }

    /// What the sweep multiplies by, besides the coefficient.
    fn factor(&self) -> f64 {
        match self.width {
            Width::F32 => 1.0,
            Width::I16 | Width::I8 => self.step,
        }
    }

    /// Its row in a tile of the group; lanes beyond the last node repeat it.
    fn row(&self, tile: usize) -> Row {
        let last = self.component.values.len() - 1;
        std::array::from_fn(|lane| self.component.values[(tile * TILE_NODES + lane).min(last)])
    }

    /// The row in whole steps.
    fn steps(&self, tile: usize) -> [i16; TILE_NODES] {
        let most = if self.width == Width::I8 { I8_MAX } else { I16_MAX };
        self.row(tile).map(|value| (value / self.step).round().clamp(-most, most) as i16)
    }

    /// The values that the sweep reads for so many nodes.
    fn read(&self, nodes: usize) -> Vec<f64> {
        let mut values = Vec::with_capacity(nodes.next_multiple_of(TILE_NODES));
        for tile in 0..nodes.div_ceil(TILE_NODES) {
            match self.width {
                Width::F32 => values.extend(self.row(tile).map(|value| f64::from(value as f32))),
                Width::I16 | Width::I8 => {
                    values.extend(self.steps(tile).map(|steps| f64::from(steps) * self.step))
                }
            }
        }
        values.truncate(nodes);
        values
    }
}

/// The rows of a list in a tile of the group.
fn push_tile(to: &mut Vec<Line>, rows: &[Stored<'_>], tile: usize) {
    let [first_i16, first_i8] =
        [Width::I16, Width::I8].map(|width| rows.partition_point(|own| own.width < width));
    for own in &rows[..first_i16] {
        push_words(to, &own.row(tile).map(|value| (value as f32).to_bits()));
    }
    for pair in rows[first_i16..first_i8].chunks(2) {
        push_words(to, &interleaved(pair, tile, |pair: [i16; 2]| word(pair) as u32));
    }
    for four in rows[first_i8..].chunks(4) {
        push_words(
            to,
            &interleaved(four, tile, |steps: [i16; 4]| {
                u32::from_le_bytes(steps.map(|steps| (i32::from(steps) + BYTE_ZERO) as u8))
            }),
        );
    }
}

/// A word a node from the steps of so many rows; rows that are not there are 0.
fn interleaved<const N: usize>(
    rows: &[Stored<'_>],
    tile: usize,
    word: impl Fn([i16; N]) -> u32,
) -> [u32; TILE_NODES] {
    let steps: [_; N] =
        std::array::from_fn(|row| rows.get(row).map_or([0; TILE_NODES], |own| own.steps(tile)));
    std::array::from_fn(|node| word(std::array::from_fn(|row| steps[row][node])))
}

fn push_words(to: &mut Vec<Line>, words: &[u32]) {
    for line in words.chunks_exact(LINE / 4) {
        let mut bytes = [0; LINE];
        bytes.chunks_exact_mut(4).zip(line).for_each(|(to, word)| to.copy_from_slice(&word.to_ne_bytes()));
        to.push(Line(bytes));
    }
}
