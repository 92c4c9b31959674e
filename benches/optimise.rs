//! Benchmark of gait optimisation: one optimum from sixteen starts on one core, and its uncertainty from two hundred
//! replicates on all cores, with five free commands of the kinematic robot and three of the semi-passive robot.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use trilink_base::cancel::CancelToken;
use trilink_fit::Alternatives;
use trilink_fit::optimise::{Bounds, Command, Objective, Search, Uncertainty};
use trilink_mechanics::{Laws, Problem};
use trilink_robot::{Gait, Robot};

const REPLICATES: u32 = 200;

/// Returns a search over the frequency, amplitudes and offsets of a robot's gait.
fn search(objective: Objective, robot: Robot, gait: Gait, laws: Laws) -> Search {
    let problem = Problem::new(robot, gait, laws, 6.0);
    let mut free = Command::all(&problem);
    free.truncate(5);
    let bounds = Bounds {
        omega_rad_s: [0.5, 12.0],
        amplitude_rad: [5.0, 60.0].map(f64::to_radians),
        rotor_amplitude_rad: [5.0, 720.0].map(f64::to_radians),
        angle_rad: 75.0_f64.to_radians(),
        rate_rad_s: 360.0_f64.to_radians(),
        power_w: None,
        torque_nm: None,
        least: None,
    };
    Search { problem, objective, free, bounds, starts: 16 }
}

/// Returns copies of a robot as bootstrap replicates; their skid coefficients deviate from the robot's by up to 5 %.
fn replicates(robot: &Robot) -> Alternatives {
    let off = |number: u32| {
        let mut robot = robot.clone();
        for (wheel, of) in robot.skid_kg_s.iter_mut().chain(&mut robot.skid_dry_n).enumerate() {
            *of *= 1.0 + 0.05 * (1.7 * f64::from(number) + 2.9 * wheel as f64).sin();
        }
        robot.into()
    };
    Alternatives { replicates: (0..REPLICATES).map(off).collect(), ..Alternatives::default() }
}

fn optima(criterion: &mut Criterion) {
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    let kinematic = Robot { skid_kg_s: [104.0, 34.0, 45.0], ..Robot::kinematic() };
    let semi_passive = Robot::semi_passive();
    let both = Gait::symmetric();
    let one_joint = Gait::passive_symmetric();
    let viscous = Laws::SKID_ROLL;
    let dry = Laws::COULOMB;
    let speed = Objective::Speed;
    let work = Objective::WorkPerMetre;
    let cases = [
        ("kinematic, skid-roll", search(speed, kinematic.clone(), both, viscous)),
        ("kinematic, skid-roll", search(work, kinematic.clone(), both, viscous)),
        ("kinematic, coulomb", search(speed, kinematic, both, dry)),
        ("semi-passive, skid-roll", search(speed, semi_passive.clone(), one_joint, viscous)),
        ("semi-passive, coulomb", search(speed, semi_passive, one_joint, dry)),
    ];
    for (name, search) in cases {
        let objective = search.objective;
        let count = search.free.len();
        let starts = search.starts;
        let of = format!("{name}: {objective} over {count} commands");
        criterion.bench_function(&format!("{of}, {starts} starts, one core"), |bencher| {
            bencher.iter(|| one.install(|| black_box(search.run(&CancelToken::default()))));
        });
        let found = search.run(&CancelToken::default()).expect("nobody cancels it");
        let alternatives = replicates(search.problem.robot.three_links().expect("three links"));
        criterion.bench_function(&format!("{of}, {REPLICATES} replicates"), |bencher| {
            bencher.iter(|| {
                black_box(Uncertainty::new(
                    &search,
                    &found.optima,
                    &alternatives,
                    &CancelToken::default(),
                ))
            });
        });
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(10);
    targets = optima
}
criterion_main!(benches);
