//! Force and tip of the actuator by a second finite-element mesh, as a table: a plant that is not the controller's model.
//!
//! For each relative stiffness of the silicone (its shear modulus over the nominal one; sheet and weight are the same) the free states give
//! tip and lowest point over the pressure; the onset of a gap is where the lowest point is the plate. In contact `F = (p - p_c(gap)) h`, with
//! `h` and the tip linear in `xi = (p - p_c) / (p_max - p_c)` and in the gap. Between two stiffnesses, and beyond the outer ones, `p_c`, `h` and the
//! tip are linear in the stiffness.

/// The states of a mesh that `softtwin-studies control --database` writes.
const SHIPPED: &str = include_str!("../../data/plant.csv");
/// Header of the file.
pub const COLUMNS: &str = "stiffness,pressure_mpa,gap_mm,contact_force_n,tip_y_mm,lowest_y_mm";

/// One state of the table; without a gap: free.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// Shear modulus of the silicone relative to the nominal one.
    pub stiffness: f64,
    /// Pressure, MPa.
    pub pressure_mpa: f64,
    /// Gap, mm; none: without a plate.
    pub gap_mm: Option<f64>,
    /// Contact force, N.
    pub contact_force_n: f64,
    /// Height of the tip, mm.
    pub tip_y_mm: f64,
    /// Height of the lowest point, mm.
    pub lowest_y_mm: f64,
}

/// The contact states of one gap.
#[derive(Debug, Clone)]
struct Column {
    gap_mm: f64,
    /// xi, force by excess pressure (N/MPa), tip (mm).
    rows: Vec<[f64; 3]>,
}

/// The states of one stiffness.
#[derive(Debug, Clone)]
struct StiffnessTable {
    stiffness: f64,
    /// Pressure, tip, lowest point.
    free: Vec<[f64; 3]>,
    columns: Vec<Column>,
}

/// The table: bodies by increasing stiffness.
#[derive(Debug, Clone)]
pub struct PlantTable {
    bodies: Vec<StiffnessTable>,
}

/// Why a table cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TableError {
    /// A line is not understood.
    #[error("line {line}: expected {COLUMNS} with numbers (gap empty for a free state), found `{found}`")]
    Line {
        /// Its number, from 1.
        line: usize,
        /// Its text.
        found: String,
    },
    /// Too little for a table.
    #[error(
        "expected two values of the stiffness, each with at least two free states and two gaps with two contact states, found by stiffness, free states and gaps {found:?}"
    )]
    TooFew {
        /// Stiffness, free states, gaps with enough contact states.
        found: Vec<(f64, usize, usize)>,
    },
}

impl PlantTable {
    /// The shipped table: the reference actuator on a grid of 17,760 nodes.
    ///
    /// # Errors
    /// None, unless the shipped file is damaged.
    pub fn shipped() -> Result<Self, TableError> {
        Self::parse(SHIPPED)
    }

    /// A table from its text; lines that begin with # are comments.
    ///
    /// # Errors
    /// [`TableError`].
    pub fn parse(text: &str) -> Result<Self, TableError> {
        let mut rows = Vec::new();
        for (index, line) in
            text.lines().enumerate().filter(|(_, line)| !line.starts_with('#') && *line != COLUMNS)
        {
            rows.push(row(line).ok_or_else(|| TableError::Line { line: index + 1, found: line.to_owned() })?);
        }
        Self::new(rows)
    }

    /// A table of states in any order.
    ///
    /// # Errors
    /// [`TableError::TooFew`].
    pub fn new(mut rows: Vec<Row>) -> Result<Self, TableError> {
        rows.sort_by(|a, b| {
            a.stiffness.total_cmp(&b.stiffness).then(a.pressure_mpa.total_cmp(&b.pressure_mpa))
        });
        let bodies: Vec<StiffnessTable> =
            rows.chunk_by(|a, b| a.stiffness == b.stiffness).map(StiffnessTable::new).collect();
        let is_enough = |body: &StiffnessTable| body.free.len() >= 2 && body.columns.len() >= 2;
        if bodies.len() < 2 || !bodies.iter().all(is_enough) {
            let count = |body: &StiffnessTable| (body.stiffness, body.free.len(), body.columns.len());
            return Err(TableError::TooFew { found: bodies.iter().map(count).collect() });
        }
        Ok(Self { bodies })
    }

    /// Contact force in N and height of the tip in mm. A gap beyond the table's counts as its end, an infinite one as no plate; beyond the
    /// highest pressure `h` and the tip are constant.
    pub fn at(&self, pressure_mpa: f64, gap_mm: f64, stiffness: f64) -> (f64, f64) {
        let above =
            self.bodies.partition_point(|body| body.stiffness < stiffness).clamp(1, self.bodies.len() - 1);
        let (a, b) = (&self.bodies[above - 1], &self.bodies[above]);
        let share = (stiffness - a.stiffness) / (b.stiffness - a.stiffness);
        let between = |of: &dyn Fn(&StiffnessTable) -> f64| {
            let (a, b) = (of(a), of(b));
            a + (b - a) * share
        };
        let onset_mpa = between(&|body| body.onset_mpa(body.nearest_mm(gap_mm)));
        // Beyond every free state of a body it is infinite, and the mean of two such is NaN, which nothing exceeds.
        let touches = pressure_mpa > onset_mpa;
        if gap_mm == f64::INFINITY || !touches {
            return (0.0, between(&|body| along(&body.free, pressure_mpa, 1)));
        }
        let xi = (pressure_mpa - onset_mpa) / (a.highest_mpa() - onset_mpa);
        let in_contact = |value: usize| between(&|body| body.at(xi, body.nearest_mm(gap_mm), value));
        ((pressure_mpa - onset_mpa) * in_contact(1), in_contact(2))
    }
}

impl StiffnessTable {
    /// States of one stiffness, by pressure.
    fn new(rows: &[Row]) -> Self {
        let free = rows.iter().filter(|row| row.gap_mm.is_none());
        let free: Vec<[f64; 3]> = free.map(|row| [row.pressure_mpa, row.tip_y_mm, row.lowest_y_mm]).collect();
        let stiffness = rows.first().map_or(f64::NAN, |row| row.stiffness);
        let mut body = Self { stiffness, free, columns: Vec::new() };
        let highest_mpa = body.highest_mpa();
        let mut gaps: Vec<f64> = rows.iter().filter_map(|row| row.gap_mm).collect();
        gaps.sort_by(f64::total_cmp);
        gaps.dedup();
        for gap_mm in gaps {
            let onset_mpa = body.onset_mpa(gap_mm);
            let touching = |row: &&Row| row.gap_mm == Some(gap_mm) && row.pressure_mpa > onset_mpa;
            let xi = |pressure_mpa: f64| (pressure_mpa - onset_mpa) / (highest_mpa - onset_mpa);
            let states: Vec<[f64; 3]> = rows
                .iter()
                .filter(touching)
                .map(|row| {
                    [xi(row.pressure_mpa), row.contact_force_n / (row.pressure_mpa - onset_mpa), row.tip_y_mm]
                })
                .collect();
            if let (Some(first), true) = (states.first(), states.len() >= 2) {
                let begin = [0.0, first[1], along(&body.free, onset_mpa, 1)];
                body.columns.push(Column { gap_mm, rows: [vec![begin], states].concat() });
            }
        }
        body
    }

    fn highest_mpa(&self) -> f64 {
        self.free.last().map_or(0.0, |row| row[0])
    }

    /// The gap, or the end of the table's that is nearest to it, mm.
    fn nearest_mm(&self, gap_mm: f64) -> f64 {
        let gap = |column: Option<&Column>| column.map_or(f64::NAN, |column| column.gap_mm);
        gap_mm.clamp(gap(self.columns.first()), gap(self.columns.last()))
    }

    /// Force by excess pressure (1) or tip (2).
    fn at(&self, xi: f64, gap_mm: f64, value: usize) -> f64 {
        let above =
            self.columns.partition_point(|column| column.gap_mm < gap_mm).clamp(1, self.columns.len() - 1);
        let (a, b) = (&self.columns[above - 1], &self.columns[above]);
        let share = (gap_mm - a.gap_mm) / (b.gap_mm - a.gap_mm);
        let (a, b) = (along(&a.rows, xi, value), along(&b.rows, xi, value));
        a + (b - a) * share
    }

    /// Pressure at which the free lowest point reaches the plate, MPa; infinite out of reach.
    fn onset_mpa(&self, gap_mm: f64) -> f64 {
        let below = self.free.windows(2).find(|pair| pair[1][2] <= -gap_mm);
        let Some([a, b]) = below.and_then(|pair| pair.first_chunk()) else { return f64::INFINITY };
        a[0] + (b[0] - a[0]) * ((a[2] + gap_mm) / (a[2] - b[2])).clamp(0.0, 1.0)
    }
}

/// Linear interpolation over the first value of the rows; beyond them the value of the end.
fn along(rows: &[[f64; 3]], at: f64, value: usize) -> f64 {
    let above = rows.partition_point(|row| row[0] < at).clamp(1, rows.len() - 1);
    let (a, b) = (rows[above - 1], rows[above]);
    a[value] + (b[value] - a[value]) * ((at - a[0]) / (b[0] - a[0])).clamp(0.0, 1.0)
}

fn row(line: &str) -> Option<Row> {
    let cells: Vec<&str> = line.split(',').collect();
    let [stiffness, pressure, gap, force, tip, lowest] = cells.as_slice() else { return None };
    let number = |text: &str| text.parse::<f64>().ok().filter(|value| value.is_finite());
    Some(Row {
        stiffness: number(stiffness)?,
        pressure_mpa: number(pressure)?,
        gap_mm: if gap.is_empty() { None } else { Some(number(gap)?) },
        contact_force_n: number(force)?,
        tip_y_mm: number(tip)?,
        lowest_y_mm: number(lowest)?,
    })
}
