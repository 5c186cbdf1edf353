//! Flights that are simulated together against each of them alone.

use std::path::Path;

use bench_plant::effects::{LIBRARY, parse_effect};
use bench_rig::{Mission, Model, Rig};
use bench_run::{Ending, Simulation, simulate_on, simulate_together};

fn rigs() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../rigs"))
}

fn rig(name: &str) -> Rig {
    Rig::load(rigs().join(name)).unwrap()
}

fn mission(name: &str) -> Mission {
    Mission::load(rigs().join("missions").join(name)).unwrap()
}

#[test]
fn together_they_come_to_what_each_comes_to_alone() {
    let nominal = [rig("virtual.toml"), rig("virtual-model.toml"), rig("crazyflie-2.toml")];
    let missions = [mission("hop.toml"), mission("hold-3d.toml")];
    // Each effect of the library, no effect, and the vertical model: with lanes and without, of several lengths.
    let mut plants: Vec<(usize, Rig)> = (0..nominal.len()).map(|of| (of, nominal[of].clone())).collect();
    for spec in LIBRARY.iter() {
        let mut plant = nominal[0].clone();
        plant.effects.push(parse_effect(&spec.example()).unwrap());
        plants.push((0, plant));
    }
    let mut vertical = nominal[0].clone();
    vertical.plant.model = Model::Vertical;
    plants.push((0, vertical));
    // What safety stops leaves its lane early.
    let mut heavy = nominal[0].clone();
    heavy.safety.ceiling_m = 0.1;
    plants.push((0, heavy));

    let mut simulations = Vec::new();
    for ((of, plant), seed) in plants.iter().zip(0..) {
        let rig = if plant.safety == nominal[*of].safety { &nominal[*of] } else { plant };
        simulations.push(Simulation { plant, rig, mission: &missions[seed as usize % 2], seed });
    }
    let together = simulate_together(&simulations);
    assert_eq!(together.len(), simulations.len());
    let mut stopped = 0;
    for (Simulation { plant, rig, mission, seed }, together) in simulations.iter().zip(&together) {
        let alone = simulate_on(plant, rig, mission, *seed, &mut (), |_| true).unwrap();
        let together = together.as_ref().unwrap();
        assert_eq!(*together, alone, "{:?} on {}", plant.effects, plant.name);
        assert!(together.summary.ticks > 10);
        stopped += usize::from(matches!(together.ending, Ending::Stopped(_)));
    }
    assert!((1..simulations.len()).contains(&stopped), "{stopped} stopped");
}

#[test]
fn a_flight_that_cannot_begin_is_an_error_in_its_place() {
    let (good, mission) = (rig("virtual.toml"), mission("hop.toml"));
    let mut bad = good.clone();
    bad.effects.push(parse_effect("no-such-effect").unwrap());
    let of = |plant| Simulation { plant, rig: &good, mission: &mission, seed: 1 };
    let flown = simulate_together(&[of(&good), of(&bad), of(&good)]);
    assert!(flown[0].is_ok() && flown[1].is_err() && flown[2].is_ok());
    assert_eq!(flown[0], flown[2]);
    assert!(simulate_together(&[]).is_empty());
}
