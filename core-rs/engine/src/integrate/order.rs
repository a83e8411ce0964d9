//! Numbering by reverse Cuthill-McKee (1969; George 1971), which keeps neighbours near each other.

/// Orders the nodes of a graph, given the neighbours of each node: returns the node at each place, (n).
pub(super) fn reverse_cuthill_mckee(neighbours: &[Vec<usize>]) -> Vec<usize> {
    let n = neighbours.len();
    let mut placed = vec![false; n];
    let mut order = Vec::with_capacity(n);
    let mut starts: Vec<usize> = (0..n).collect();
    starts.sort_by_key(|&node| (neighbours[node].len(), node));
    for start in starts {
        if placed[start] {
            continue;
        }
        let first = order.len();
        breadth_first(
            peripheral_node(start, neighbours),
            neighbours,
            &mut placed,
            &mut order,
        );
        order[first..].reverse();
    }
    order
}

/// Breadth-first search from a node; the neighbours of a node are visited by rising degree. Appends the nodes reached
/// to `order` and returns the number of levels.
fn breadth_first(
    start: usize,
    neighbours: &[Vec<usize>],
    placed: &mut [bool],
    order: &mut Vec<usize>,
) -> usize {
    let mut level = order.len();
    order.push(start);
    placed[start] = true;
    let mut levels = 0;
    while level < order.len() {
        let end = order.len();
        for at in level..end {
            let from = order.len();
            for &next in &neighbours[order[at]] {
                if !placed[next] {
                    placed[next] = true;
                    order.push(next);
                }
            }
            order[from..].sort_by_key(|&node| (neighbours[node].len(), node));
        }
        level = end;
        levels += 1;
    }
    levels
}

/// A node at the far end of its component (George & Liu 1979): moves to the last node that a search reaches, as long as
/// this increases the number of levels.
fn peripheral_node(start: usize, neighbours: &[Vec<usize>]) -> usize {
    let search = |from: usize| {
        let (mut seen, mut order) = (vec![false; neighbours.len()], Vec::new());
        let levels = breadth_first(from, neighbours, &mut seen, &mut order);
        (levels, order.last().copied().unwrap_or(from))
    };
    let (mut node, (mut levels, mut last)) = (start, search(start));
    loop {
        let (deeper, end) = search(last);
        if deeper <= levels {
            return node;
        }
        (node, levels, last) = (last, deeper, end);
    }
}
