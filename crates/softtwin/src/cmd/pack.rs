//! `softtwin pack`: a database small enough for a repository, with a stated bound on every value's error; and back.

use crate::failure::usage;
use crate::files::refusal;
use crate::report;
use formats::database::{Manifest, PACKED, StoredKind, obstacle_kinds, pack_sensitivities, read_snapshots};
use formats::packed::{self, Snapshots, Stored};
use formats::{file, npy};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
  softtwin pack --database target/database/pneunet --out models/pneunet/database
  softtwin pack --database database --out small --length-error-mm 0.01 \\
    --stress-error-mpa 1e-4
  Back to snapshots.npy (float32, cases x nodes x fields), for other programs:
    softtwin pack --unpack --database models/pneunet/database --out plain

`softtwin train --database` reads the packed folder like any other. The displacement magnitude is not stored but taken \
from the coordinates and the mesh.";

/// Pack a database's snapshots: every value within a stated error, a fraction of the size.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Database folder with snapshots.npy or packed snapshots (with --unpack: the latter).
    #[arg(long, value_name = "DIR")]
    database: PathBuf,
    /// Folder to write.
    #[arg(long, value_name = "DIR", help_heading = "Output")]
    out: PathBuf,
    /// Largest error of a coordinate in mm.
    #[arg(long, value_name = "MM", default_value_t = 1e-5, value_parser = crate::range::number(1e-9, 1e6))]
    length_error_mm: f64,
    /// Largest error of a stress, and of any other field in its unit, in MPa.
    #[arg(long, value_name = "MPA", default_value_t = 1e-7, value_parser = crate::range::number(1e-12, 1e6))]
    stress_error_mpa: f64,
    /// Largest error of a coordinate's derivative, as a fraction of the largest value of its row and field. Only those of training
    /// states are kept.
    #[arg(long, value_name = "SHARE", default_value_t = 1e-4, value_parser = crate::range::number(1e-7, 0.1))]
    derivative_error: f64,
    /// The same of a stress's derivative, and of any other field's; these lose less by it.
    #[arg(long, value_name = "SHARE", default_value_t = 1e-3, value_parser = crate::range::number(1e-7, 0.1))]
    stress_derivative_error: f64,
    /// The other way: packed snapshots to snapshots.npy.
    #[arg(long)]
    unpack: bool,
    /// Print one JSON object instead of text.
    #[arg(long, help_heading = "Output")]
    json: bool,
}

/// Name of snapshots that are not packed.
const PLAIN: &str = "snapshots.npy";

#[derive(Serialize)]
struct PackReport {
    bytes_before: usize,
    bytes: usize,
    bytes_of_derivatives: Option<usize>,
    /// Of each field, in its unit.
    largest_error: BTreeMap<String, f32>,
}

#[derive(Serialize)]
struct UnpackReport {
    cases: usize,
    nodes: usize,
    fields: usize,
    snapshots: PathBuf,
}

impl Args {
    /// Packs, reads back, measures, writes.
    pub fn run(self) -> anyhow::Result<()> {
        let manifest = Manifest::read(&self.database.join("database.toml")).map_err(refusal)?;
        // A table of cases that is not this description's (of other parameters) is not carried on.
        obstacle_kinds(&self.database).map_err(refusal)?;
        let mesh = match &manifest.mesh {
            Some(file) => Some(formats::vtu::read(&self.database.join(file)).map_err(refusal)?.points_mm),
            None => None,
        };
        if self.unpack {
            return self.write_plain(&manifest, mesh.as_deref());
        }
        let snapshots = self.snapshots(&manifest)?;
        let fields = self.fields(&manifest, mesh.is_some());
        let bytes = packed::pack(&snapshots, &fields).map_err(anyhow::Error::msg)?;
        let back = packed::unpack(&bytes, mesh.as_deref()).map_err(anyhow::Error::msg)?;
        let errors = errors(&snapshots, &back);
        file::create_folder(&self.out)?;
        let packed = Path::new("snapshots").with_extension(PACKED).display().to_string();
        file::replace(&self.out.join(&packed), &bytes)?;
        self.copy_rest(&manifest, &[])?;
        let share = |kind| match kind {
            StoredKind::Coordinate | StoredKind::Magnitude => self.derivative_error,
            StoredKind::Stress | StoredKind::Other => self.stress_derivative_error,
        };
        let derivatives = pack_sensitivities(&self.database, &self.out, &manifest, share)?;
        let array = manifest.sensitivities.as_deref().map(|name| (name, "sensitivities.pack"));
        self.describe(&manifest, [Some((&*manifest.snapshots, &*packed)), array])?;
        let names = manifest.field.iter().map(|field| field.name.clone());
        let report = PackReport {
            bytes_before: snapshots.values.len() * 4,
            bytes: bytes.len(),
            bytes_of_derivatives: derivatives,
            largest_error: names.zip(errors).collect(),
        };
        report::print(&report, self.json)
    }

    fn snapshots(&self, manifest: &Manifest) -> anyhow::Result<Snapshots> {
        let path = self.database.join(&manifest.snapshots);
        let mesh = manifest.mesh.as_ref().map(|file| self.database.join(file));
        read_snapshots(&path, mesh.as_deref()).map_err(refusal)
    }

    /// The distance can be left out only behind the three coordinates it follows from.
    fn fields(&self, manifest: &Manifest, has_mesh: bool) -> Vec<Stored> {
        // Parameters may move the undeformed mesh, so that the distance no longer follows from one mesh.
        let has_mesh = has_mesh && manifest.input.iter().all(|input| input.nominal.is_none());
        let leading = manifest.field.iter().map(|f| f.name.as_str()).take(3).eq(["x", "y", "z"]);
        let stored = |kind| match kind {
            StoredKind::Magnitude if leading && has_mesh => Stored::Distance,
            StoredKind::Coordinate | StoredKind::Magnitude => Stored::Steps(2.0 * self.length_error_mm),
            StoredKind::Stress | StoredKind::Other => Stored::Steps(2.0 * self.stress_error_mpa),
        };
        manifest.field.iter().map(|f| stored(f.kind)).collect()
    }

    /// The other way: packed snapshots to an array that other programs read.
    fn write_plain(&self, manifest: &Manifest, mesh: Option<&[[f64; 3]]>) -> anyhow::Result<()> {
        if Path::new(&manifest.snapshots).extension().is_none_or(|ending| ending != PACKED) {
            return Err(usage(format!("--unpack: expected packed snapshots, found {}", manifest.snapshots)));
        }
        let snapshots = packed::read(&self.database.join(&manifest.snapshots), mesh).map_err(refusal)?;
        file::create_folder(&self.out)?;
        let path = self.out.join(PLAIN);
        npy::write_f32(&path, &snapshots.shape, &snapshots.values).map_err(refusal)?;
        self.copy_rest(manifest, &[manifest.sensitivities.as_deref(), Some("sensitivities.csv")])?;
        self.describe(manifest, [Some((&*manifest.snapshots, PLAIN)), None])?;
        let [cases, nodes, fields] = snapshots.shape;
        report::print(&UnpackReport { cases, nodes, fields, snapshots: path }, self.json)
    }

    /// Files that are copied unpacked, and files named by the caller.
    fn copy_rest(&self, manifest: &Manifest, more: &[Option<&str>]) -> anyhow::Result<()> {
        let tables =
            [Some(manifest.cases.as_str()), manifest.mesh.as_deref(), manifest.undeformed_by.as_deref()];
        let names = tables.iter().chain(more).flatten().chain(&["volumes.csv", "residuals.csv"]);
        for name in names.filter(|name| self.database.join(name).is_file()) {
            file::copy(&self.database.join(name), &self.out.join(name))?;
        }
        Ok(())
    }

    /// The description with the new names of files.
    fn describe(&self, manifest: &Manifest, names: [Option<(&str, &str)>; 2]) -> anyhow::Result<()> {
        let [from, to] = [&self.database, &self.out].map(|folder| folder.join("database.toml"));
        let names: Vec<_> = names.into_iter().flatten().collect();
        Ok(manifest.copy_with_names(&from, &to, &names)?)
    }
}

/// Largest error of each field.
fn errors(before: &Snapshots, after: &Snapshots) -> Vec<f32> {
    let fields = before.shape[2];
    let mut errors = vec![0.0_f32; fields];
    for (i, (a, b)) in before.values.iter().zip(&after.values).enumerate() {
        errors[i % fields] = errors[i % fields].max((a - b).abs());
    }
    errors
}
