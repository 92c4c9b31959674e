//! Titles and captions: `texts.toml`.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use minijinja::value::Value;
use minijinja::{Environment, UndefinedBehavior};

type Texts = BTreeMap<String, [String; 2]>;

/// Title and caption of a figure with these values.
pub fn texts(name: &str, values: Value) -> [String; 2] {
    static TEXTS: LazyLock<Texts> =
        LazyLock::new(|| toml::from_str(include_str!("texts.toml")).unwrap_or_default());
    let mut environment = Environment::new();
    environment.set_undefined_behavior(UndefinedBehavior::Strict);
    let fill = |text: &String| {
        environment.render_str(text, &values).unwrap_or_else(|error| error.to_string())
    };
    TEXTS.get(name).map(|texts| texts.each_ref().map(fill)).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_figure_says_is_filled_in() {
        let all: Texts = toml::from_str(include_str!("texts.toml")).expect("well formed");
        let values = minijinja::context! {
            campaigns => vec!["a", "b"],
            debiased => false,
            bars => "Bars.",
            models => ["skid-roll"],
            input => "commanded gait",
        };
        let [title, caption] = texts("skid", values);
        assert_eq!(title, "Skid ratios of campaigns a and b");
        assert_eq!(
            caption,
            "Skid ratio σ (eq. 20): RMS skid speed of a wheel over lω, the markers' noise \
             included. Bars. Lines: the fitted model skid-roll under the commanded gait, shaded the \
             95 % interval where there is one."
        );
        assert!(all.values().flatten().all(|text| !text.contains("  ") && !text.contains('\n')));
    }
}
