//! Tables of benches: layouts, mappings, and what is reported of them.

use formats::Diagnostic;
use formats::log::{Log, Mapping};
use formats::table::TableForm;
use proptest::prelude::*;
use std::path::Path;

fn parse(text: &str) -> Result<Log, Diagnostic> {
    Log::parse(text, &TableForm::default())
}

fn same(text: &str, headings: &[&str]) {
    let log = parse(text).unwrap();
    assert_eq!(log.headings, headings, "{text:?}");
    assert_eq!(log.columns, [[0.0, 0.5, 1.0], [1.5, 2.5, -3.0]], "{text:?}");
    assert!(log.damaged.is_empty(), "{text:?}: {:?}", log.damaged);
}

#[test]
fn layouts_of_benches_are_one_table() {
    let named = ["Time (s)", "Pressure (kPa)"];
    same("Time (s),Pressure (kPa)\n0,1.5\n0.5,2.5\n1,-3\n", &named);
    same("Time (s);Pressure (kPa)\r\n0;1,5\r\n0,5;2,5\r\n1;-3,0\r\n", &named);
    same("\u{feff}# made by hand\r# Time (s), Pressure (kPa)\r0,1.5\r0.5,2.5\r1,-3\r", &named);
    same("# Time (s)  Pressure (kPa)\n0\t1.5\n0.5\t2.5\n1\t-3\n", &named);
    same("0  1.5\n0.5   2.5\n 1.0 -3e0\n", &["", ""]);
    same("0 1,5\n0,5 2,5\n1 -3\n", &["", ""]);
    same("Width (mm);6;;\nMachine;X 5569;;\n;;;\nTime;Pressure\n(s);(kPa)\n0;1.5\n0.5;2.5\n1;-3\n", &named);
    same("Time (s);Pressure (kPa)\n0,0;1,5\n0,5;2,5\n1,0;-3,0\n", &named);
    same("# Rate = 5%/s\n# Time (s) Pressure (kPa)\n0 1.5\n0.5 2.5\n1 -3\n", &named);
    same("Time (s) Pressure (kPa)\n0 1.5\n0.5 2.5\n1 -3\n", &named);
    same("Time (s);Pressure (kPa);\n0;1.5\n0.5;2.5\n1;\u{2212}3\n", &named);
    same("\"Time (s)\",\"Pressure (kPa)\"\n\"0\",\"1.5\"\n0.5,2.5\n1,-3\n", &named);
}

#[test]
fn lines_with_labels_are_rows() {
    let named = ["t", "p"];
    same("Booting...\nt:0,p:1.5\nt:0.5,p:2.5\nt:1,p:-3\n", &named);
    same("t: 0\tp: 1.5\nt: 0.5\tp: 2.5\nt: 1\tp: -3\n", &named);
    same("t=0 p=1.5\nt=0.5 p=2.5\nt=1 p=-3\n", &named);
    same("Booting v1.2\n0 s, p: 1.5 kPa\n0.5 s, p: 2.5 kPa\n1 s, p: -3 kPa\n", &["[s]", "p [kPa]"]);
    same("{\"t\": 0, \"p\": 1.5}\n{\"t\": 0.5, \"p\": 2.5}\n{\"t\": 1, \"p\": -3}\n", &named);
    let clocks =
        |heading: &str| format!("{heading}00:00:00.000 -> 1.5\n00:00:00.500 -> 2.5\n00:00:01.000 -> -3\n");
    same(&clocks(""), &["", ""]);
    same(&clocks("00:00:00.000 -> p\n"), &["time", "p"]);
    let last = parse("t:0,p:1\nt:1,p:2\nt:2,p:3\nt:3,p").unwrap();
    assert_eq!((last.rows(), last.damaged.len()), (3, 1), "{last:?}");
    let head = parse("Width;6;mm\nWidth, cm\nt;p\n0;1\n1;2\n").unwrap();
    assert_eq!(head.parameters, [("Width (mm)".to_owned(), 6.0)]);
}

#[test]
fn clocks_are_seconds() {
    let log =
        parse("2023-01-10T23:59:59.5Z,1\n2023-01-11T00:00:00Z,2\n2023-01-11T02:00:01+02:00,3\n").unwrap();
    let steps: Vec<f64> = log.columns[0].windows(2).map(|t| t[1] - t[0]).collect();
    assert_eq!(steps, [0.5, 1.0]);
    assert_eq!(log.columns[0][1], 1_673_395_200.0);
    assert_eq!(parse("00:00:23.50\t1\n00:01:00.00\t2\n").unwrap().columns[0], [23.5, 60.0]);
}

#[test]
fn headings_of_motion_capture_and_instruments_are_joined() {
    let motive = "Format,1.2,Take,3\n\n,,Marker,,,Marker,,\n,,tip,,,mid,,\nFrame,Time (s),X,Y,Z,X,Y,Z\n0,0,1,2,3,4,5,6\n1,0.1,1,2,3,4,5,6\n";
    let log = parse(motive).unwrap();
    assert_eq!(
        log.headings[1..6],
        ["Time (s)", "Marker tip X", "Marker tip Y", "Marker tip Z", "Marker mid X"]
    );
    let labview = "LabVIEW Measurement\t\nVersion\t2\n***End***\t\nSamples\t1200\t1200\nDate\t2021/06/03\t2021/06/03\n\
                   Delta_X\t0.05\t0.05\n***End***\t\t\nX_Value\tPressure (kPa)\tAngle\tComment\n0\t1\t2\n0.1\t2\t3\n0.2\t3\t4\n";
    let log = parse(labview).unwrap();
    assert_eq!(log.headings, ["X_Value", "Pressure (kPa)", "Angle"]);
    assert_eq!((log.rows(), log.columns[0][2], log.separator), (3, 0.2, '\t'));
    assert!(!log.damaged.is_empty(), "rows among the parameters are named");
    let units = labview.replace("Samples\t1200\t1200", "Y_Unit_Label\tV\tdeg");
    assert_eq!(parse(&units).unwrap().headings, ["X_Value", "Pressure (kPa)", "Angle [deg]"]);
    let metres = motive.replace("Take,3", "Length Units,Meters");
    assert_eq!(parse(&metres).unwrap().headings[2], "Marker tip X [Meters]");
    let tracked =
        "scorer,net,net,net\nparts,tip,tip,tip\ncoords,x,y,likelihood\n0,1.5,2,0.9\n1,1,2,0.9\n2,1,2,0.9\n";
    assert_eq!(parse(tracked).unwrap().headings[1..3], ["tip x", "tip y"]);
}

#[test]
fn commas_between_quotes_are_decimal_or_thousands_by_the_file() {
    let german = parse("\"Zeit [ms]\",\"Druck\"\n\"0,5\",\"30,063\"\n\"50,0\",\"1,5\"\n").unwrap();
    assert_eq!(german.columns, [[0.5, 50.0], [30.063, 1.5]]);
    let english = parse("t,p\n0.5,\"1,234.5\"\n1.5,\"12,000.5\"\n").unwrap();
    assert_eq!(english.columns[1], [1234.5, 12_000.5]);
    assert_eq!(parse("0;1.234,5\n1;-1.000.000,25\n").unwrap().columns[1], [1234.5, -1_000_000.25]);
}

#[test]
fn clocks_with_halves_of_the_day_are_seconds() {
    let log = parse("5/4/2023 11:59:59.5 AM,1\n5/4/2023 12:00:00 PM,2\n5/4/2023 1:00:00 PM,3\n").unwrap();
    let steps: Vec<f64> = log.columns[0].windows(2).map(|t| t[1] - t[0]).collect();
    assert_eq!(steps, [0.5, 3600.0]);
    assert_eq!(parse("12:00:01 AM\t1\n12:00:02 AM\t1\n").unwrap().columns[0], [1.0, 2.0]);
}

#[test]
fn damaged_lines_and_missing_values_are_reported() {
    let log = parse("t,p\n0,1\n1,nan\n2,\n3,broken,4\nt,p\n4,5\n5").unwrap();
    assert_eq!(log.lines, [2, 3, 4, 7]);
    assert!(log.columns[1][1].is_nan() && log.columns[1][2].is_nan());
    let places: Vec<&str> = log.damaged.iter().map(|d| d.place.as_str()).collect();
    assert_eq!(places, ["line 5", "line 6", "line 8"]);
    assert!(parse("only words\n").is_err());
}

#[test]
fn encodings_of_spreadsheets_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.csv");
    let text = "t,angle (\u{b0})\n0,1\n1,2\n";
    let wide: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
    let narrow: Vec<u8> = text.chars().map(|c| c as u8).collect();
    for bytes in [text.as_bytes().to_vec(), [&[0xff, 0xfe], &wide[..]].concat(), narrow] {
        std::fs::write(&path, bytes).unwrap();
        let log = Log::read(&path, &TableForm::default()).unwrap();
        assert_eq!((log.headings[1].as_str(), log.rows()), ("angle (\u{b0})", 2));
    }
}

#[test]
fn rows_are_in_order_of_time_and_a_second_run_is_refused() {
    let channel = "[[input]]\nname = \"pressure_mpa\"\ncolumn = 2\nunit = \"MPa\"\n";
    let mapping = mapping(&format!("{TIME}{channel}")).unwrap();
    let apply = |text: &str| mapping.apply(&parse(text).unwrap(), Path::new("run.csv"));
    let sorted = apply("0,1\n20,3\n10,2\nnan,7\n30,4\n").unwrap();
    assert_eq!(
        (&sorted.time_s[..], &sorted.inputs[0].values[..]),
        (&[0.0, 0.01, 0.02, 0.03][..], &[1.0, 2.0, 3.0, 4.0][..])
    );
    let rows = |from: i32| (from..from + 100).map(|row| format!("{row},{row}\n")).collect::<String>();
    let error = apply(&format!("{}{}", rows(0), rows(0))).unwrap_err().to_string();
    assert!(error.contains("line 101"), "{error}");
}

#[test]
fn clocks_of_two_files_are_joined_by_correlation() {
    let folder = tempfile::tempdir().unwrap();
    let pressure = |t: f64| (0.9 * t).sin() + 0.7 * (0.31 * t + 1.0).sin() + 0.3 * (2.3 * t).cos();
    let table = |name: &str, rows: u32, step: f64, value: &dyn Fn(f64) -> f64, from: f64| {
        let lines: String = (0..rows)
            .map(|row| f64::from(row) * step)
            .map(|t| format!("{},{}\n", t + from, value(t)))
            .collect();
        std::fs::write(folder.path().join(name), lines).unwrap();
    };
    table("valve.csv", 900, 0.05, &pressure, 100.0);
    // The camera starts 3.2 s later, with another clock.
    table("camera.csv", 500, 0.08, &|t| -4.0 * pressure(t + 3.2), 7000.0);
    let channel = |kind: &str, name: &str, unit: &str| {
        format!("[[{kind}]]\nname = \"{name}\"\ncolumn = 2\nunit = \"{unit}\"\n")
    };
    let time = "time = { column = 1, unit = \"s\" }\n";
    let text = format!(
        "{time}{}[[file]]\n{time}{}",
        channel("input", "pressure_mpa", "MPa"),
        channel("file.output", "tip_x_mm", "mm")
    );
    let read = |text: &str, name: &str| {
        mapping(text).unwrap().read_run(&folder.path().join(name)).map_err(|error| error.to_string())
    };
    let joined = read(&text, "valve.csv+camera.csv").unwrap();
    let tip = &joined.outputs[0].values;
    for row in [100, 400, 700] {
        let exact = -4.0 * joined.inputs[0].values[row];
        assert!((tip[row] - exact).abs() < 0.15, "{} {exact}: {:?}", tip[row], joined.remarks);
    }
    assert!(
        tip[0].is_nan() && joined.remarks.iter().any(|remark| remark.contains("offset_s = -6896.")),
        "{:?}",
        joined.remarks
    );
    assert!(read(&text, "valve.csv").unwrap_err().contains("2 files"));
    let given = text.replace("[[file]]\n", "[[file]]\noffset_s = -6896.8\n");
    let joined = read(&given, "valve.csv+camera.csv").unwrap();
    assert!((joined.outputs[0].values[400] + 4.0 * joined.inputs[0].values[400]).abs() < 0.02);
    table("still.csv", 500, 0.08, &|_| 1.0, 0.0);
    assert!(read(&text, "valve.csv+still.csv").unwrap_err().contains("offset_s"));
}

#[test]
fn lag_of_an_output_is_no_offset_and_two_offsets_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let text = "time = { column = 1, unit = \"s\" }\n[[input]]\nname = \"p_mpa\"\ncolumn = 2\nunit = \"MPa\"\n\
                [[file]]\ntime = { column = 1, unit = \"s\" }\n[[file.output]]\nname = \"x_mm\"\ncolumn = 2\nunit = \"mm\"\n";
    let read = |pressure: &dyn Fn(f64) -> f64| {
        let (mut x, mut valve, mut camera) = (0.0, String::new(), String::new());
        for row in 0..1000_u32 {
            let t = 0.05 * f64::from(row);
            x += (1.0 - f64::exp(-0.05 / 0.6)) * (pressure(t) - x);
            valve += &format!("{t},{}\n", pressure(t));
            camera += &format!("{},{x}\n", t + 40.0);
        }
        std::fs::write(folder.path().join("valve.csv"), valve).unwrap();
        std::fs::write(folder.path().join("camera.csv"), camera).unwrap();
        mapping(text).unwrap().read_run(&folder.path().join("valve.csv+camera.csv"))
    };
    let steps = |t: f64| f64::from(((t / 2.7) as u32 * 7 + (t / 4.3) as u32 * 3) % 5);
    let joined = read(&steps).unwrap();
    let found = joined.remarks.iter().find_map(|remark| remark.split_once("offset_s = ")).unwrap().1;
    let offset_s: f64 = found.split(' ').next().unwrap().parse().unwrap();
    assert!((offset_s + 40.0).abs() < 0.15, "{:?}", joined.remarks);
    let refused = read(&|t| (0.8 * t).sin()).unwrap_err().to_string();
    assert!(refused.contains("correlations of") && refused.contains(" and -"), "{refused}");
}

#[test]
fn topics_written_at_different_instants_are_interpolated() {
    let row = |row: u32| match row % 2 {
        0 => format!("{},{},,\n", 10 * row, row),
        _ => format!("{},,{},0.9\n", 10 * row, row),
    };
    let table = "t_ms,/p/data[0],x,likelihood\n".to_owned() + &(0..40).map(row).collect::<String>();
    let text = "time = { column = 1, unit = \"ms\" }\n[[input]]\nname = \"p_mpa\"\ncolumn = \"/p/data[0]\"\nunit = \"MPa\"\n\
                [[output]]\nname = \"x_mm\"\ncolumn = 3\nunit = \"mm\"\nconfidence = 4\n";
    let read =
        |table: &str, text: &str| mapping(text).unwrap().apply(&parse(table).unwrap(), Path::new("run"));
    let found = read(&table, text).unwrap();
    assert!((found.inputs[0].values[7] - 7.0).abs() < 1e-12 && found.outputs[0].values[7] == 7.0);
    assert!(
        found.outputs[0].values[8].is_nan()
            && found.remarks.iter().any(|remark| remark.contains("p_mpa: written"))
    );
    // Frames are counted, and a position without confidence is missing.
    let frames = text.replace("unit = \"ms\" }", "rate_hz = 20 }");
    let found = read(&table.replace("7,0.9", "7,0.2"), &frames).unwrap();
    assert!((found.time_s[1] - 0.5).abs() < 1e-12 && found.outputs[0].values[7].is_nan());
}

#[test]
fn frame_moves_a_camera_plane_and_refuses_a_rotation_out_of_it() {
    let marker = |axis: &str, column: u8| {
        format!("[[output]]\nname = \"tip_{axis}_mm\"\ncolumn = {column}\nunit = \"mm\"\n")
    };
    let frame = |rows: &str| {
        let text = format!(
            "{TIME}{}{}[frame]\nrotation = {rows}\norigin_mm = [1.0, 2.0, 3.0]\n",
            marker("x", 2),
            marker("y", 3)
        );
        mapping(&text).unwrap().apply(&parse("0,10,20\n1,11,20\n").unwrap(), Path::new("run.csv"))
    };
    let turned = frame("[[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]").unwrap();
    assert_eq!([turned.outputs[0].values[0], turned.outputs[1].values[0]], [-19.0, 12.0]);
    assert!(frame("[[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]").is_err());
}

fn mapping(text: &str) -> Result<Mapping, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.toml");
    std::fs::write(&path, text).unwrap();
    Mapping::read(&path).map_err(|error| error.to_string())
}

const TIME: &str = "[time]\ncolumn = 1\nunit = \"ms\"\n";

#[test]
fn columns_become_quantities() {
    let channels = r#"
        [[input]]
        name = "pressure_mpa"
        column = "P"
        unit = "psi"
        zero_s = 1.0
        [[input]]
        name = "supply_kpa"
        column = 3
        unit = "bar"
        slope = 0.5
        offset = -1.0
        [[output]]
        name = "tip_x_mm"
        column = 4
        unit = "px"
        mm_per_px = 0.25
        sign = -1
        [[output]]
        name = "tip_y_mm"
        column = 5
        unit = "cm"
        [[output]]
        name = "tip_z_mm"
        column = 5
        unit = "m"
        [frame]
        rotation = [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
        origin_mm = [100.0, 0.0, 0.0]
    "#;
    let log = parse("t,p,counts,u,y\n500,1,4,8,1\n1500,1,4,8,1\n2500,11,6,8,2\n").unwrap();
    let found = mapping(&format!("{TIME}{channels}")).unwrap().apply(&log, Path::new("run.csv")).unwrap();
    assert_eq!(found.time_s, [0.0, 1.0, 2.0]);
    assert_eq!(found.inputs[0].values[1], 0.0);
    assert!((found.inputs[0].values[2] - 0.068_947_57).abs() < 1e-7);
    assert!((found.inputs[1].values[2] - 200.0).abs() < 1e-9);
    let tip: Vec<f64> = found.outputs.iter().map(|series| series.values[2]).collect();
    assert_eq!(tip, [120.0, 2.0, 2000.0]);
    assert!(found.csv().starts_with("t_s,pressure_mpa,supply_kpa,tip_x_mm"));
}

#[test]
fn wrong_mappings_are_refused() {
    let channel = |name: &str, column: &str, more: &str| {
        format!("{TIME}[[input]]\nname = \"{name}\"\ncolumn = {column}\n{more}\n")
    };
    for (text, part) in [
        (channel("pressure_mpa", "2", "unit = \"furlong\""), "furlong"),
        (channel("pressure_mpa", "2", "unit = \"mm\""), "Pressure"),
        (channel("pressure", "2", "unit = \"kPa\""), "pressure_mpa"),
        (channel("pressure_mpa", "2", "unit = \"kPa\"\nsign = 2"), "1 or -1"),
        (channel("tip_x_mm", "2", "unit = \"px\""), "mm_per_px"),
        (channel("pressure_mpa", "2", "unit = \"kPa\"\ncolour = 1"), "colour"),
        ("[time]\nunit = \"s\"\n".to_owned(), "rate_hz"),
        ("[time]\nrate_hz = 1e308\n".to_owned(), "time.rate_hz"),
        ("[time]\nrate_hz = 0.0\n".to_owned(), "time.rate_hz"),
        (channel("pressure_mpa", "2", "unit = \"kPa\"\nzero_s = 1e300"), "zero_s"),
        (channel("pressure_mpa", "2", "unit = \"kPa\"\nzero_s = nan"), "zero_s"),
        (channel("pressure_mpa", "2", "unit = \"kPa\"\nslope = 1e300"), "slope"),
        (channel("pressure_mpa", "2", "unit = \"kPa\"\noffset = -inf"), "offset"),
        (channel("tip_x_mm", "2", "unit = \"px\"\nmm_per_px = 1e300"), "mm_per_px"),
        (channel("../../pressure_mpa", "2", "unit = \"kPa\""), "letters"),
        (channel("pressure\\n_mpa", "2", "unit = \"kPa\""), "letters"),
        (channel(&format!("{}_mpa", "p".repeat(100)), "2", "unit = \"kPa\""), "letters"),
        (
            format!(
                "{TIME}[frame]\nrotation = [[2.0,0.0,0.0],[0.0,1.0,0.0],[0.0,0.0,1.0]]\norigin_mm = [0.0,0.0,0.0]\n"
            ),
            "rotation",
        ),
    ] {
        let found = mapping(&text).unwrap_err();
        assert!(found.contains(part), "{part} is not in {found}");
    }
    let log = parse("0,1\n1,2\n").unwrap();
    for column in ["7", "0", "\"q\""] {
        let mapping = mapping(&channel("pressure_mpa", column, "unit = \"kPa\"")).unwrap();
        assert!(mapping.apply(&log, Path::new("run.csv")).is_err(), "{column}");
    }
}

/// A message is read by a person, whatever the file is.
#[test]
fn files_that_are_no_tables_are_refused_with_a_short_message() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.csv");
    let noise: Vec<u8> = (0..5000_u32).map(|k| (k.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    let wide = "1,".repeat(1_000_000);
    let archive = [&[0x1f, 0x8b, 8, 0][..], &noise].concat();
    for (bytes, part) in
        [(archive, "gzip"), (noise, "binary"), (format!("a\n{wide}\n").into_bytes(), "line 2")]
    {
        std::fs::write(&path, bytes).unwrap();
        let found = Log::read(&path, &TableForm::default()).unwrap_err().to_string();
        assert!(found.contains(part) && found.len() < 2000, "{part}: {} bytes", found.len());
    }
    std::fs::write(&path, format!("t_s,{wide}\n0,{wide}\n")).unwrap();
    let found = formats::table::Table::read(&path, true).unwrap_err().to_string();
    assert!(found.contains("columns") && found.len() < 2000, "{} bytes", found.len());
    // A heading of any length in a table that is one.
    let log = parse(&format!("t,{}\n0,1\n1,2\n", "x".repeat(1_000_000))).unwrap();
    let mapping =
        mapping(&format!("{TIME}[[input]]\nname = \"p_mpa\"\ncolumn = \"q\"\nunit = \"kPa\"\n")).unwrap();
    let found = mapping.apply(&log, Path::new("run.csv")).unwrap_err().to_string();
    assert!(found.contains("`q`") && found.len() < 5000, "{} bytes", found.len());
    // Degrees and micro signs of Latin-1 stay text.
    std::fs::write(&path, b"t (s),T (\xb0C)\n0,1\n1,2\n").unwrap();
    assert_eq!(Log::read(&path, &TableForm::default()).unwrap().rows(), 2);
}

#[test]
fn faults_of_sensors_and_clocks_are_remarked() {
    let mut text = String::new();
    for row in 0..100_i32 {
        let p = f64::from((row - 50).abs()).min(40.0) - 5.0;
        let t = if row == 20 {
            19
        } else if row == 30 {
            28
        } else {
            row
        };
        let gap = if (60..70).contains(&row) { "nan".into() } else { format!("{row}") };
        text += &format!("{t},{p},{gap},7\n");
    }
    let channels: String = ["pressure_mpa", "x_mm", "y_mm"]
        .iter()
        .enumerate()
        .map(|(at, name)| {
            let unit = name.rsplit('_').next().unwrap();
            format!("[[input]]\nname = \"{name}\"\ncolumn = {}\nunit = \"{unit}\"\n", at + 2)
        })
        .collect();
    let mapping = mapping(&format!("{TIME}{channels}")).unwrap();
    let found = mapping.apply(&parse(&text).unwrap(), Path::new("run.csv")).unwrap();
    for part in [
        "time: 1 repeated stamps, the first in line 21",
        "time: 1 stamps before the one above (sorted), the first in line 31",
        "pressure_mpa: saturated?",
        "pressure_mpa: negative",
        "x_mm: 10 of 100 values missing, at most 10 in a row",
        "y_mm: constant",
    ] {
        assert!(found.remarks.iter().any(|remark| remark.starts_with(part)), "{part}: {:?}", found.remarks);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Columns in any order, named by their headings: each quantity has the values of its column. A heading that two columns have is
    /// refused.
    #[test]
    fn columns_in_any_order_have_their_values(
        order in Just((0_usize..4).collect::<Vec<_>>()).prop_shuffle(),
        values in prop::collection::vec(prop::array::uniform4(-9.0_f64..9.0), 2..6),
        twice in 0_usize..4,
        separator in prop::sample::select(vec![",", ";", "\t"]),
    ) {
        let headings = ["time", "gauge", "supply", "tip"];
        let cell = |row: usize, column: usize| if column == 0 { row as f64 } else { values[row][column] };
        let table = |columns: &[usize]| {
            let line = |cells: Vec<String>| cells.join(separator) + "\n";
            let rows = (0..values.len()).map(|row| line(columns.iter().map(|c| cell(row, *c).to_string()).collect()));
            line(columns.iter().map(|c| headings[*c].to_owned()).collect()) + &rows.collect::<String>()
        };
        let channel = |kind: &str, name: &str, column: &str, unit: &str| {
            format!("[[{kind}]]\nname = \"{name}\"\ncolumn = \"{column}\"\nunit = \"{unit}\"\n")
        };
        let mapping = mapping(&format!(
            "time = {{ column = \"time\", unit = \"s\" }}\n{}{}{}",
            channel("input", "pressure_mpa", "gauge", "kPa"),
            channel("input", "supply_mpa", "supply", "bar"),
            channel("output", "tip_x_mm", "tip", "cm"),
        ))
        .unwrap();
        let apply = |table: &str| mapping.apply(&parse(table).unwrap(), Path::new("run.csv"));
        let found = apply(&table(&order)).unwrap();
        let series = [(&found.inputs[0].values, 1e-3), (&found.inputs[1].values, 0.1), (&found.outputs[0].values, 10.0)];
        for (column, (found, factor)) in (1..4).zip(series) {
            for (row, found) in found.iter().enumerate() {
                let expected = cell(row, column) * factor;
                prop_assert!((found - expected).abs() <= 1e-12 * expected.abs(), "{} of row {row}", headings[column]);
            }
        }
        prop_assert!(apply(&table(&[&order[..], &[twice]].concat())).is_err(), "{} twice", headings[twice]);
    }
}

/// `2.100` is 2.1 or 2100: the other numbers tell, or nobody does.
#[test]
fn groups_of_thousands_are_told_by_the_table_or_the_column_has_no_values() {
    let last = |text: &str| *parse(text).unwrap().columns[1].last().unwrap();
    assert_eq!(last("t;f\n0,5;976\n1,5;2.100\n"), 2100.0);
    assert_eq!(last("t\tf\n0.5\t976\n1.5\t2,100\n"), 2100.0);
    assert_eq!(last("t,f\n0.5,976\n1.5,\"2,100\"\n"), 2100.0);
    assert_eq!(last("t;f\n0.5;976\n1.5;2'100\n"), 2100.0);
    assert_eq!(last("t;f\n0,5;976\n1,5;2\u{202f}100,5\n"), 2100.5);
    assert_eq!(last("t;f\n1;1.250\n2;2.100\n"), 2.1);
    let doubtful = parse("t;f\n1;976\n2;2.100\n").unwrap();
    assert!(doubtful.doubts[1].is_some() && doubtful.columns[1].iter().all(|v| v.is_nan()));
    assert!(parse("t;f\n1;0,5\n2;0.5\n").unwrap().doubts[1].is_some());
    let said = TableForm { decimal: Some(','), ..TableForm::default() };
    assert_eq!(Log::parse("t;f\n1;976\n2;2.100\n", &said).unwrap().columns[1], [976.0, 2100.0]);
    let remarks = parse("t;f\n0,5;976\n1,5;2.100\n").unwrap().remarks;
    assert_eq!(remarks.len(), 1, "{remarks:?}");
}

#[test]
fn headings_of_rows_with_names_are_refused_until_the_mapping_tells() {
    let table = "\"strain\",\"stress\"\n\"1\",0.01,0.002\n\"2\",0.02,0.004\n";
    assert_eq!(parse(table).unwrap_err().place, "line 1");
    let form = |row_names| TableForm { row_names: Some(row_names), ..TableForm::default() };
    assert_eq!(Log::parse(table, &form(true)).unwrap().headings, ["", "strain", "stress"]);
    assert_eq!(Log::parse(table, &form(false)).unwrap().headings, ["strain", "stress", ""]);
    // A separator at the end of each row is no column, an empty cell at its begin is one.
    assert_eq!(parse("t;p\n0;1;\n1;2;\n").unwrap().headings, ["t", "p", ""]);
    let named = parse("\tt\tp\n0\t0.5\t1\n1\t1.5\t2\n").unwrap();
    assert_eq!(
        (&named.headings[1..], &named.columns[1][..]),
        (&["t".into(), "p".into()][..], &[0.5, 1.5][..])
    );
    assert_eq!(parse("t\ta\tb\n0\t1\t2\n1\t1\t\n2\t\t\n").unwrap().rows(), 3);
    let inches = parse("Time (s),Extension (\"),Load (lbf)\n0,1,2\n1,2,3\n").unwrap();
    assert_eq!(inches.headings, ["Time (s)", "Extension (\")", "Load (lbf)"]);
}

#[test]
fn dates_and_clocks_are_read_by_their_column() {
    let span = |rows: [&str; 2]| {
        let log = parse(&format!("{},1\n{},2\n", rows[0], rows[1])).unwrap();
        log.columns[0][1] - log.columns[0][0]
    };
    assert_eq!(span(["09/03/2024 23:59:59", "10/03/2024 00:00:00"]), 1.0);
    assert_eq!(span(["3/9/2024 23:59:59", "3/10/2024 00:00:00"]), 1.0);
    assert_eq!(span(["31/01/2024 23:59:59", "01/02/2024 00:00:00"]), 1.0);
    assert_eq!(span(["00:59.5", "01:00.0"]), 0.5);
    assert_eq!(span(["10:00:00:500", "10:00:01:000"]), 0.5);
    let doubt = |text: &str| parse(text).unwrap().doubts[0].is_some();
    assert!(doubt("12:30,1\n12:31,2\n") && doubt("03/03/2024 10:00:00,1\n05/05/2024 10:00:00,2\n"));
    let glued = parse("t=0ms P=30.0kPa\nt=20ms P=31.0kPa\n").unwrap();
    assert_eq!((glued.headings[0].as_str(), &glued.columns[1][..]), ("t [ms]", &[30.0, 31.0][..]));
}

#[test]
fn angles_are_continued_and_lost_markers_are_missing() {
    let text = format!(
        "{TIME}[[input]]\nname = \"pressure_mpa\"\ncolumn = 2\nunit = \"kPa\"\n[[output]]\nname = \"angle_deg\"\ncolumn = 3\nunit = \"deg\"\n\
         [[output]]\nname = \"tip_x_mm\"\ncolumn = 4\nunit = \"mm\"\n[[output]]\nname = \"tip_y_mm\"\ncolumn = 5\nunit = \"mm\"\n"
    );
    let mapping = mapping(&text).unwrap();
    let mut table = String::new();
    for row in 0..100_i32 {
        let angle = f64::from((row * 3 + 180) % 360 - 180);
        let (x, y) = match row {
            40..50 => (0.0, 0.0),
            60..75 => (60.5, 30.25),
            _ => (f64::from(row) + 0.5, 0.5 * f64::from(row) + 0.25),
        };
        table += &format!("{row},{row},{angle},{x},{y}\n");
    }
    let found = mapping.apply(&parse(&table).unwrap(), Path::new("run.csv")).unwrap();
    assert_eq!(found.outputs[0].values[99], 297.0);
    let missing: Vec<usize> = (0..100).filter(|row| found.outputs[1].values[*row].is_nan()).collect();
    assert_eq!(missing, (40..50).chain(61..75).collect::<Vec<_>>());
    assert!(found.outputs[2].values[41].is_nan() && found.outputs[2].values[39] == 19.75);
    let backwards = mapping.apply(&parse("3,1,1,1,1\n2,1,1,1,1\n1,1,1,1,1\n").unwrap(), Path::new("run.csv"));
    assert!(backwards.is_err());
}
