//! Titles and captions of the figures, from the templates in `texts.toml`.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use minijinja::value::Value;
use minijinja::{Environment, UndefinedBehavior};

type Texts = BTreeMap<String, [String; 2]>;

/// Renders the title and the caption of a figure: the templates called `name` in `texts.toml`, filled in with `values`.
pub(crate) fn texts(name: &str, values: Value) -> [String; 2] {
    static TEXTS: LazyLock<Texts> =
        LazyLock::new(|| toml::from_str(include_str!("texts.toml")).unwrap_or_default());
    let mut environment = Environment::new();
    environment.set_undefined_behavior(UndefinedBehavior::Strict);
    let Some(templates) = TEXTS.get(name) else {
        return Default::default();
    };
    templates.each_ref().map(|template| {
        environment.render_str(template, &values).unwrap_or_else(|error| error.to_string())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn caption_templates_are_filled_in() {
        let all: Texts = toml::from_str(include_str!("texts.toml")).expect("well formed");
        let values = minijinja::context! {
            campaigns => vec!["a", "b"],
            debiased => false,
            bars => "Bars.",
            input => "commanded gait",
            of_trials => Vec::<&str>::new(),
        };
        let [title, caption] = texts("skid", values);
        assert_eq!(title, "Skid ratios of campaigns a and b");
        assert_eq!(
            caption,
            "Skid ratio σ (eq. 20): RMS skid speed of a wheel divided by lω, not corrected for \
             marker noise. Bars. Lines: the preferred fitted model with skid of each campaign, \
             under the commanded gait; shaded: 95 % intervals, where known."
        );
        let from_rest = |settled: Option<usize>, drawn: usize| {
            let values = minijinja::context! {
                campaign => "a", model => "skid", omega => "4", values => "as configured", settled, drawn,
                cycles => None::<usize>, path_cycles => 3,
            };
            let [_, caption] = texts("from-rest", values);
            caption.split(". ").nth(1).unwrap_or_default().to_owned()
        };
        let settled = "From rest the motion comes within 1 % of the steady one after";
        assert_eq!(from_rest(Some(1), 1), format!("{settled} 1 cycle"));
        assert_eq!(
            from_rest(Some(55), 40),
            format!("{settled} 55 cycles, of which the first 40 are drawn")
        );
        let not_found = "From rest the motion did not come within 1 % of the steady one during the \
                         simulation; its first 40 cycles are drawn";
        assert_eq!(from_rest(None, 40), not_found);
        assert!(all.values().flatten().all(|text| !text.contains("  ") && !text.contains('\n')));
    }
}
