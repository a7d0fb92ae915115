//! Which of the worlds that nodes remember a coordinator goes on from, when one of them may lie.

use super::super::agreement::Unfit;
use super::*;

/// A node may claim terms so far above those of others before they are passed over.
const FAR: u64 = 1 << 16;

fn with(change: impl FnOnce(&mut Checkpoint)) -> Checkpoint {
    let mut changed = checkpoint();
    change(&mut changed);
    changed
}

/// Of a run's later second.
fn later(seconds: u64) -> Checkpoint {
    with(|changed| changed.kept.sequence += seconds)
}

fn bytes(checkpoint: &Checkpoint) -> Bytes {
    checkpoint.to_bytes().expect("short").into()
}

fn home() -> Home {
    Home::new(checkpoint().place, checkpoint().world.scene())
}

/// What is recalled of nodes that remember these, the newest first.
fn recall(nodes: &[&[&Checkpoint]]) -> Recalled {
    let nodes: Vec<Vec<Bytes>> =
        nodes.iter().map(|kept| kept.iter().map(|&checkpoint| bytes(checkpoint)).collect()).collect();
    let found = home().recall(&nodes);
    let reversed: Vec<_> = nodes.into_iter().rev().collect();
    assert_eq!(home().recall(&reversed).newest, found.newest, "in any order of the nodes");
    found
}

#[test]
fn the_newest_that_two_nodes_have_is_gone_on_from() {
    let whole = checkpoint();
    let next_run = with(|other| (other.kept.run, other.kept.sequence) = (8, 1));
    let next_term = with(|other| other.kept = Moment { term: 2, run: 1, sequence: 1, unix_s: 1e9 });
    let newest = |kept: &[&Checkpoint]| recall(&[kept, kept]).newest.map(|found| found.kept);
    assert_eq!(newest(&[]), None);
    assert_eq!(newest(&[&whole, &later(1)]), Some(later(1).kept));
    assert_eq!(newest(&[&whole, &next_run]), Some(whole.kept), "which went on for longer");
    assert_eq!(newest(&[&next_term, &later(1)]), Some(next_term.kept));
}

#[test]
fn a_coordinator_killed_between_two_nodes_goes_on_from_the_world_before() {
    // The first has taken the third second already, the second not yet.
    let found = recall(&[&[&later(2), &later(1)], &[&later(1), &checkpoint()]]);
    assert_eq!(found.newest, Some(later(1)));
    assert_eq!((found.highest_term, found.unfit), (1, None));
}

#[test]
fn a_world_that_one_node_alone_has_is_not_read() {
    let poisoned = with(|other| other.kept.sequence = u64::MAX);
    let found = recall(&[&[&poisoned, &poisoned], &[&later(1)], &[&later(1)]]);
    assert_eq!(found.newest, Some(later(1)), "twice from one node is one node");
    let found = recall(&[&[&poisoned], &[], &[&later(1)]]);
    assert_eq!((found.newest, found.unfit), (None, Some(Unfit::Disputed)));
    // The other node of two was restarted, or claims so.
    let found = recall(&[&[&poisoned], &[]]);
    assert_eq!((found.newest, found.unfit), (None, Some(Unfit::Disputed)));
}

#[test]
fn a_room_of_one_node_goes_on_from_all_there_is() {
    let found = recall(&[&[&later(2), &later(1)]]);
    assert_eq!((found.newest, found.unfit), (Some(later(2)), None));
}

#[test]
fn a_term_far_above_the_known_one_is_passed_over() {
    let of_term = |term| with(|other| other.kept.term = term);
    let highest = |term| recall(&[&[&of_term(term)], &[&checkpoint()], &[&checkpoint()]]).highest_term;
    assert_eq!(highest(2), 2, "a coordinator that was killed at once had reached one node");
    assert_eq!(highest(1 + FAR), 1 + FAR);
    for far in [2 + FAR, u64::MAX - 1, u64::MAX] {
        assert_eq!(highest(far), 1, "{far}");
    }
    // A single node that claims the last term of all does not end the order of worlds, either.
    for far in [u64::MAX - 1, u64::MAX] {
        let alone = recall(&[&[&of_term(far)]]);
        assert_eq!((alone.newest.is_none(), alone.highest_term), (true, 0), "{far}");
        assert!(matches!(alone.unfit, Some(Unfit::Unreadable(_))), "{:?}", alone.unfit);
    }
}

#[test]
fn worlds_of_other_rigs_and_scenes_are_passed_over_by_name() {
    let of_another_rig = with(|other| other.place.rig = [9; 32]);
    let of_another_scene = with(|other| other.place.scene = [9; 32]);
    // A run of this scene in which a follower chose another, that does not come with the program.
    let foreign = Scene::from_toml("topple", "gravity = [0, -9.81, 0]").expect("a scene");
    let foreign = World::new(&foreign, WorldSettings::default()).expect("a world").snapshot();
    let of_foreign = with(|other| other.world = foreign);
    for (found, expected) in [
        (of_another_rig, "it is of another rig"),
        (of_another_scene, "it began with another scene, or with this one before it was edited"),
        (of_foreign, "its scene `topple` is neither the run's own nor one that comes with the program"),
    ] {
        let recalled = recall(&[&[&found], &[&found]]);
        assert_eq!(recalled.newest, None);
        assert_eq!(recalled.unfit.expect("why").to_string(), expected);
        assert_eq!(recall(&[&[&later(1), &found], &[&later(1), &found]]).newest, Some(later(1)));
    }
    let chosen = Scene::named("topple").expect("shipped");
    let chosen = World::new(&chosen, WorldSettings::default()).expect("a world").snapshot();
    let of_chosen = with(|other| other.world = chosen);
    assert_eq!(recall(&[&[&of_chosen], &[&of_chosen]]).newest, Some(of_chosen));
}
