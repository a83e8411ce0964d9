//! Names of modules; members of a generator share one name: `string` → `string.12`.

/// The names of coordinates.
const AXES: [char; 3] = ['x', 'y', 'z'];

/// Consecutive modules under one name.
#[derive(Clone, Debug, PartialEq)]
struct NameGroup {
    first: usize,
    len: usize,
    /// Whether members are shown with their number.
    is_numbered: bool,
    /// Number of the first member.
    first_number: usize,
    name: String,
    /// Suffix after the number: the axis of a coordinate.
    axis: Option<char>,
    /// Index of the middle member.
    centre: usize,
}

/// The names of a network's MATs and LIAs.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Names {
    mats: Vec<NameGroup>,
    links: Vec<NameGroup>,
}

fn find_group(groups: &[NameGroup], index: usize) -> Option<&NameGroup> {
    let group_index = groups.partition_point(|group| group.first + group.len <= index);
    groups.get(group_index).filter(|group| group.first <= index)
}

fn full_name(groups: &[NameGroup], index: usize) -> String {
    let Some(name_group) = find_group(groups, index) else {
        return format!("#{index}");
    };
    let mut module_name = name_group.name.clone();
    if name_group.is_numbered {
        module_name += &format!(".{}", name_group.first_number + index - name_group.first);
    }
    if let Some(axis_letter) = name_group.axis {
        module_name.push('.');
        module_name.push(axis_letter);
    }
    module_name
}

/// The groups of the modules `indices` (rising indices), renumbered.
fn renumbered(groups: &[NameGroup], indices: &[u32]) -> Vec<NameGroup> {
    let mut cut_groups: Vec<NameGroup> = Vec::new();
    let mut previous_index: Option<usize> = None;
    for (local, &module_index) in indices.iter().enumerate() {
        let module_index = module_index as usize;
        let Some(name_group) = find_group(groups, module_index) else {
            continue;
        };
        let is_continued = previous_index == module_index.checked_sub(1) && module_index > name_group.first;
        previous_index = Some(module_index);
        match cut_groups.last_mut().filter(|_| is_continued) {
            Some(last) => last.len += 1,
            None => cut_groups.push(NameGroup {
                first: local,
                len: 1,
                first_number: name_group.first_number + module_index - name_group.first,
                ..name_group.clone()
            }),
        }
    }
    cut_groups
}

impl Names {
    /// The names of some modules, by their rising indices.
    pub(super) fn subset(&self, mats: &[u32], links: &[u32]) -> Self {
        Self {
            mats: renumbered(&self.mats, mats),
            links: renumbered(&self.links, links),
        }
    }

    pub(super) fn add_mats(&mut self, first: usize, len: usize, is_numbered: bool, name: String, centre: usize) {
        self.mats.push(NameGroup {
            first,
            len,
            is_numbered,
            first_number: 0,
            name,
            axis: None,
            centre,
        });
    }

    /// Coordinates of points along one axis.
    pub(super) fn add_coordinates(&mut self, first: usize, len: usize, is_numbered: bool, name: String, axis: usize) {
        self.mats.push(NameGroup {
            first,
            len,
            is_numbered,
            first_number: 0,
            name,
            axis: Some(AXES[axis]),
            centre: len / 2,
        });
    }

    pub(super) fn add_links(&mut self, first: usize, len: usize, is_numbered: bool, name: String) {
        self.links.push(NameGroup {
            first,
            len,
            is_numbered,
            first_number: 0,
            name,
            axis: None,
            centre: 0,
        });
    }

    pub(super) fn mat(&self, index: usize) -> String {
        full_name(&self.mats, index)
    }

    pub(super) fn link(&self, index: usize) -> String {
        full_name(&self.links, index)
    }

    /// How many MATs the module that begins at `first` has.
    pub(super) fn count(&self, first: usize) -> usize {
        find_group(&self.mats, first).map_or(0, |group| group.len - (first - group.first))
    }

    /// The middle MAT of the module that begins at `first`.
    pub(super) fn centre(&self, first: usize) -> usize {
        find_group(&self.mats, first).map_or(first, |group| group.first + group.centre)
    }
}
