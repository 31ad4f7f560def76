//! Force and tip of the actuator by a second finite-element mesh, as a table: a plant that is not the controller's model.
//!
//! The free states give tip and lowest point over the pressure; the onset of a gap is where the lowest point is the plate. In
//! contact `F = (p - p_c(gap)) h`, with `h` and the tip linear in `xi = (p - p_c) / (p_max - p_c)` and in the gap. A body whose
//! silicone and sheet are all `k` times as stiff has the shape of `p / k` and `k` times its force, its weight and the plate's give aside.

/// The states of a mesh that `softtwin-studies control --database` writes.
const SHIPPED: &str = include_str!("../../data/plant.csv");
/// Header of the file.
pub const COLUMNS: &str = "pressure_mpa,gap_mm,contact_force_n,tip_y_mm,lowest_y_mm";

/// One state of the table; without a gap: free.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
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

/// The table.
#[derive(Debug, Clone)]
pub struct PlantTable {
    /// Pressure, tip, lowest point.
    free: Vec<[f64; 3]>,
    columns: Vec<Column>,
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
        "expected at least two free states and two gaps with two contact states each, found {free} and {gaps}"
    )]
    TooFew {
        /// Free states.
        free: usize,
        /// Gaps with enough contact states.
        gaps: usize,
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
        for (at, line) in
            text.lines().enumerate().filter(|(_, line)| !line.starts_with('#') && *line != COLUMNS)
        {
            rows.push(row(line).ok_or_else(|| TableError::Line { line: at + 1, found: line.to_owned() })?);
        }
        Self::new(rows)
    }

    /// A table of states in any order.
    ///
    /// # Errors
    /// [`TableError::TooFew`].
    pub fn new(mut rows: Vec<Row>) -> Result<Self, TableError> {
        rows.sort_by(|a, b| a.pressure_mpa.total_cmp(&b.pressure_mpa));
        let free = rows.iter().filter(|row| row.gap_mm.is_none());
        let free: Vec<[f64; 3]> = free.map(|row| [row.pressure_mpa, row.tip_y_mm, row.lowest_y_mm]).collect();
        let mut table = Self { free, columns: Vec::new() };
        let highest_mpa = table.free.last().map_or(0.0, |row| row[0]);
        let mut gaps: Vec<f64> = rows.iter().filter_map(|row| row.gap_mm).collect();
        gaps.sort_by(f64::total_cmp);
        gaps.dedup();
        for gap_mm in gaps {
            let onset_mpa = table.onset_mpa(gap_mm);
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
                let begin = [0.0, first[1], along(&table.free, onset_mpa, 1)];
                table.columns.push(Column { gap_mm, rows: [vec![begin], states].concat() });
            }
        }
        if table.free.len() < 2 || table.columns.len() < 2 {
            return Err(TableError::TooFew { free: table.free.len(), gaps: table.columns.len() });
        }
        Ok(table)
    }

    /// Smallest and largest gap of the table, mm.
    pub fn gaps_mm(&self) -> [f64; 2] {
        let gap = |column: Option<&Column>| column.map_or(f64::NAN, |column| column.gap_mm);
        [gap(self.columns.first()), gap(self.columns.last())]
    }

    /// Contact force in N and height of the tip in mm of a body `stiffness` times as stiff. A gap beyond the table's counts as
    /// its end, an infinite one as no plate; beyond the highest pressure `h` and the tip are constant.
    pub fn at(&self, pressure_mpa: f64, gap_mm: f64, stiffness: f64) -> (f64, f64) {
        let [nearest, farthest] = self.gaps_mm();
        let is_free = gap_mm == f64::INFINITY;
        let (pressure_mpa, gap_mm) = (pressure_mpa / stiffness, gap_mm.clamp(nearest, farthest));
        let onset_mpa = self.onset_mpa(gap_mm);
        if is_free || pressure_mpa <= onset_mpa {
            return (0.0, along(&self.free, pressure_mpa, 1));
        }
        let highest_mpa = self.free.last().map_or(0.0, |row| row[0]);
        let xi = (pressure_mpa - onset_mpa) / (highest_mpa - onset_mpa);
        let above =
            self.columns.partition_point(|column| column.gap_mm < gap_mm).clamp(1, self.columns.len() - 1);
        let (a, b) = (&self.columns[above - 1], &self.columns[above]);
        let share = (gap_mm - a.gap_mm) / (b.gap_mm - a.gap_mm);
        let between = |value: usize| {
            let (a, b) = (along(&a.rows, xi, value), along(&b.rows, xi, value));
            a + (b - a) * share
        };
        (stiffness * (pressure_mpa - onset_mpa) * between(1), between(2))
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
    let [pressure, gap, force, tip, lowest] = cells.as_slice() else { return None };
    let number = |text: &str| text.parse::<f64>().ok().filter(|value| value.is_finite());
    Some(Row {
        pressure_mpa: number(pressure)?,
        gap_mm: if gap.is_empty() { None } else { Some(number(gap)?) },
        contact_force_n: number(force)?,
        tip_y_mm: number(tip)?,
        lowest_y_mm: number(lowest)?,
    })
}
