use super::*;

#[test]
fn no_fault_exceeds_its_bound() {
    let found = measure().unwrap();
    assert_eq!(found.len(), Fault::ALL.len() * Emulator::ALL.len());
    let broken: Vec<_> = found.iter().filter(|one| one.exceeds()).collect();
    assert!(broken.is_empty(), "{broken:#?}");
}

#[test]
fn the_same_figures_come_out_again() {
    assert_eq!(measure().unwrap(), measure().unwrap());
}
