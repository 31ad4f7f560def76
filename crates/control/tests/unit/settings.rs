use super::*;

fn read(text: &str) -> Settings {
    toml::from_str(text).unwrap()
}

#[test]
fn a_quantity_has_its_own_settings_where_its_table_says_so() {
    let all = read(
        "delay_s = 0.05\nswing_hz = 4.0\nplay = [{ threshold = 1e-3, weight = 1.0 }]\n\
         [tip]\nswing_hz = 3.0\nplay = []\nlaw = \"predictive\"\n",
    );
    assert_eq!(all.problems("control"), Vec::<String>::new());
    let [force, tip] = ["force", "tip"].map(|name| all.of(name).unwrap());
    assert_eq!((force.swing_hz, force.play.len(), force.law), (4.0, 1, LawKind::Inverse));
    assert_eq!((tip.swing_hz, tip.play.len(), tip.law, tip.delay_s), (3.0, 0, LawKind::Predictive, 0.05));
    assert!(tip.tip.is_empty() && force.tip.is_empty());
    assert_eq!(table_of("bending_angle_deg"), "observable");
}

#[test]
fn what_is_no_setting_of_a_quantity_is_named_with_its_place() {
    let wrong = [
        ("[tip]\nswing = 3.0", "control.tip: unknown field `swing`"),
        ("[force]\nswing_hz = -1.0", "control.force.swing_hz: "),
        ("[force]\nhold = \"tip\"", "control.force: hold: "),
        ("[force.tip]\nswing_hz = 1.0", "control.force: tip: "),
    ];
    for (text, begins) in wrong {
        let problems = read(text).problems("control");
        assert!(problems.len() == 1 && problems[0].starts_with(begins), "{problems:?}");
    }
}
