//! The order in which the unknowns of a sparse symmetric matrix are eliminated so that there is little fill-in:
//! approximate minimum degree on a quotient graph.
//!
//! Source: Amestoy, Davis, Duff, "An approximate minimum degree ordering algorithm", SIAM J. Matrix Anal. Appl. 17
//! (1996).

use crate::interrupt;

/// The order of elimination (n,) of a matrix whose row i has entries off its diagonal in the columns
/// `columns[row_starts[i]..first[i + 1]]`.
pub(super) fn elimination_order(row_starts: &[usize], columns: &[u32]) -> Vec<u32> {
    let node_count = row_starts.len() - 1;
    let mut graph = Graph::new(row_starts, columns);
    let (mut pivots, mut eliminated_count) = (Vec::new(), 0);
    while eliminated_count < node_count {
        interrupt::poll();
        let pivot = graph.buckets.take_least();
        pivots.push(pivot);
        eliminated_count += graph.node_weights[pivot as usize] as usize;
        graph.eliminate(pivot, node_count - eliminated_count);
    }
    graph.expand(&pivots)
}

/// The quotient graph. Remaining unknowns are nodes; a node stands also for the unknowns that were merged into it.
/// Eliminated unknowns are elements; an element connects all its nodes with each other.
struct Graph {
    /// Neighbours of each node that share no element with it   (n)
    nodes: Vec<Vec<u32>>,
    /// Elements that each node belongs to   (n)
    elements: Vec<Vec<u32>>,
    /// Nodes of each element; empty once the element is absorbed   (n)
    members: Vec<Vec<u32>>,
    /// How many unknowns each element connects   (n)
    element_sizes: Vec<u32>,
    is_alive: Vec<bool>,
    /// How many unknowns each node stands for: 0 once it is merged or eliminated   (n)
    node_weights: Vec<u32>,
    /// The node that each was merged into   (n)
    merged_into: Vec<Option<u32>>,
    buckets: Buckets,
    /// Stamp of the last visit to each node   (n)
    visit_stamps: Vec<u32>,
    stamp: u32,
    /// Number of unknowns of each element outside the newest one, and the stamp of that count   (n)
    outside_counts: Vec<(u32, u32)>,
}

impl Graph {
    fn new(row_starts: &[usize], columns: &[u32]) -> Self {
        let node_count = row_starts.len() - 1;
        let nodes: Vec<Vec<u32>> = (0..node_count)
            .map(|i| columns[row_starts[i]..row_starts[i + 1]].to_vec())
            .collect();
        let mut buckets = Buckets::new(node_count);
        for (i, neighbours) in nodes.iter().enumerate() {
            buckets.insert(i as u32, neighbours.len() as u32);
        }
        Self {
            nodes,
            elements: vec![Vec::new(); node_count],
            members: vec![Vec::new(); node_count],
            element_sizes: vec![0; node_count],
            is_alive: vec![false; node_count],
            node_weights: vec![1; node_count],
            merged_into: vec![None; node_count],
            buckets,
            visit_stamps: vec![0; node_count],
            stamp: 0,
            outside_counts: vec![(0, 0); node_count],
        }
    }

    /// Eliminate a node: it becomes an element; `unknowns_left` unknowns remain.
    fn eliminate(&mut self, pivot: u32, unknowns_left: usize) {
        let pivot_index = pivot as usize;
        let mut adjacent_nodes = self.neighbours(pivot);
        self.node_weights[pivot_index] = 0;
        let adjacent_weight: u32 = adjacent_nodes
            .iter()
            .map(|&node| self.node_weights[node as usize])
            .sum();
        let stamp = self.stamp;
        for &node in &adjacent_nodes {
            for &element in &self.elements[node as usize] {
                let (outside, last_stamp) = &mut self.outside_counts[element as usize];
                if *last_stamp != stamp {
                    (*outside, *last_stamp) = (self.element_sizes[element as usize], stamp);
                }
                if self.is_alive[element as usize] {
                    *outside -= self.node_weights[node as usize];
                }
            }
        }
        let mut hashed_nodes: Vec<(u64, u32)> = Vec::with_capacity(adjacent_nodes.len());
        for &node in &adjacent_nodes {
            let node_index = node as usize;
            let (outside, is_alive, members) = (&self.outside_counts, &mut self.is_alive, &mut self.members);
            self.elements[node_index].retain(|&element| {
                // An element without nodes outside the new one is absorbed by it.
                let is_retained = is_alive[element as usize] && outside[element as usize].0 > 0;
                if !is_retained {
                    is_alive[element as usize] = false;
                    members[element as usize] = Vec::new();
                }
                is_retained
            });
            let (weights, stamps) = (&self.node_weights, &self.visit_stamps);
            self.nodes[node_index].retain(|&j| weights[j as usize] > 0 && stamps[j as usize] != stamp);
            let other_weight = adjacent_weight - weights[node_index];
            let separate_weight = self.elements[node_index]
                .iter()
                .map(|&element| outside[element as usize].0)
                .sum::<u32>()
                + self.nodes[node_index].iter().map(|&j| weights[j as usize]).sum::<u32>();
            let degree_bound = self.buckets.degrees[node_index].saturating_add(other_weight);
            let new_degree = (unknowns_left as u32 - weights[node_index])
                .min(degree_bound)
                .min(separate_weight + other_weight);
            self.buckets.remove(node);
            self.buckets.degrees[node_index] = new_degree;
            self.elements[node_index].push(pivot);
            let list_hash = |all: &[u32]| all.iter().map(|&x| u64::from(x) + 1).sum::<u64>();
            hashed_nodes.push((
                list_hash(&self.elements[node_index]) * 31 + list_hash(&self.nodes[node_index]),
                node,
            ));
        }
        self.merge(&mut hashed_nodes);
        adjacent_nodes.retain(|&node| self.node_weights[node as usize] > 0);
        for &node in &adjacent_nodes {
            self.buckets.insert(node, self.buckets.degrees[node as usize]);
        }
        self.members[pivot_index] = adjacent_nodes;
        self.element_sizes[pivot_index] = adjacent_weight;
        self.is_alive[pivot_index] = adjacent_weight > 0;
    }

    /// All nodes that are connected to a node, directly or by an element; its elements are absorbed.
    fn neighbours(&mut self, pivot: u32) -> Vec<u32> {
        self.stamp += 1;
        let (current_stamp, weights, stamps) = (self.stamp, &self.node_weights, &mut self.visit_stamps);
        stamps[pivot as usize] = current_stamp;
        let mut adjacent_nodes = Vec::new();
        let mut add_unseen = |nodes: Vec<u32>| {
            for j in nodes {
                if weights[j as usize] > 0 && stamps[j as usize] != current_stamp {
                    stamps[j as usize] = current_stamp;
                    adjacent_nodes.push(j);
                }
            }
        };
        add_unseen(std::mem::take(&mut self.nodes[pivot as usize]));
        for e in std::mem::take(&mut self.elements[pivot as usize]) {
            add_unseen(std::mem::take(&mut self.members[e as usize]));
            self.is_alive[e as usize] = false;
        }
        adjacent_nodes
    }

    /// Merge nodes that have the same neighbours and elements; `hashed_nodes` holds a hash of these for each
    /// node.
    fn merge(&mut self, hashed_nodes: &mut [(u64, u32)]) {
        hashed_nodes.sort_unstable();
        for group in hashed_nodes.chunk_by(|a, b| a.0 == b.0) {
            for (index, &(_, node)) in group.iter().enumerate() {
                let node_index = node as usize;
                if self.node_weights[node_index] == 0 {
                    continue;
                }
                for &(_, other) in &group[index + 1..] {
                    let other_index = other as usize;
                    let is_alike = self.node_weights[other_index] > 0
                        && are_equal_lists(&mut self.elements, node_index, other_index)
                        && are_equal_lists(&mut self.nodes, node_index, other_index);
                    if !is_alike {
                        continue;
                    }
                    self.buckets.degrees[node_index] -= self.node_weights[other_index];
                    self.node_weights[node_index] += self.node_weights[other_index];
                    self.node_weights[other_index] = 0;
                    self.merged_into[other_index] = Some(node);
                    self.nodes[other_index] = Vec::new();
                    self.elements[other_index] = Vec::new();
                }
            }
        }
    }

    /// The final order: each pivot, followed by the nodes that were merged into it.
    fn expand(&self, pivots: &[u32]) -> Vec<u32> {
        let node_count = self.merged_into.len();
        let mut merged_nodes: Vec<Vec<u32>> = vec![Vec::new(); node_count];
        for (i, &target_node) in self.merged_into.iter().enumerate() {
            if let Some(target_node) = target_node {
                merged_nodes[target_node as usize].push(i as u32);
            }
        }
        let mut full_order = Vec::with_capacity(node_count);
        let mut pending_nodes = Vec::new();
        for &pivot in pivots {
            pending_nodes.push(pivot);
            while let Some(node) = pending_nodes.pop() {
                full_order.push(node);
                pending_nodes.extend(&merged_nodes[node as usize]);
            }
        }
        full_order
    }
}

/// Whether two lists hold the same numbers; sorts both.
fn are_equal_lists(lists: &mut [Vec<u32>], i: usize, j: usize) -> bool {
    if lists[i].len() != lists[j].len() {
        return false;
    }
    lists[i].sort_unstable();
    lists[j].sort_unstable();
    lists[i] == lists[j]
}

/// Nodes in doubly linked lists, one list for each degree.
struct Buckets {
    first_nodes: Vec<Option<u32>>,
    next_nodes: Vec<Option<u32>>,
    previous_nodes: Vec<Option<u32>>,
    degrees: Vec<u32>,
    least_degree: usize,
}

impl Buckets {
    fn new(n: usize) -> Self {
        Self {
            first_nodes: vec![None; n.max(1)],
            next_nodes: vec![None; n],
            previous_nodes: vec![None; n],
            degrees: vec![0; n],
            least_degree: 0,
        }
    }

    fn insert(&mut self, node: u32, degree: u32) {
        let (node_index, bucket) = (node as usize, degree as usize);
        self.degrees[node_index] = degree;
        let next_node = self.first_nodes[bucket];
        (self.next_nodes[node_index], self.previous_nodes[node_index]) = (next_node, None);
        if let Some(next_node) = next_node {
            self.previous_nodes[next_node as usize] = Some(node);
        }
        self.first_nodes[bucket] = Some(node);
        self.least_degree = self.least_degree.min(bucket);
    }

    fn remove(&mut self, node: u32) {
        let node_index = node as usize;
        let (previous_node, next_node) = (self.previous_nodes[node_index], self.next_nodes[node_index]);
        match previous_node {
            None => self.first_nodes[self.degrees[node_index] as usize] = next_node,
            Some(previous_node) => self.next_nodes[previous_node as usize] = next_node,
        }
        if let Some(next_node) = next_node {
            self.previous_nodes[next_node as usize] = previous_node;
        }
    }

    /// Remove and return a node of the least degree; there must be one.
    fn take_least(&mut self) -> u32 {
        loop {
            if let Some(least_node) = self.first_nodes[self.least_degree] {
                self.remove(least_node);
                return least_node;
            }
            self.least_degree += 1;
        }
    }
}
