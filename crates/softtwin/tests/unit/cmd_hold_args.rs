use super::*;

#[test]
fn only_a_trace_or_an_option_ends_a_hold() {
    #[derive(clap::Parser)]
    struct Line {
        #[command(flatten)]
        args: Args,
    }
    let seconds = |more: &[&str]| {
        let line = ["hold", "--scene", "scene.toml", "--force-n", "0.3"].iter().chain(more);
        <Line as clap::Parser>::parse_from(line).args.seconds(&Goal::step(0.3))
    };
    assert_eq!(seconds(&[]), f64::INFINITY);
    assert_eq!(seconds(&["--seconds", "5"]), 5.0);
}
