/* Which node each vertex is: docs/format.md, section 10, "Order of the vertices". */
#ifndef MM_ORDER_H
#define MM_ORDER_H

#include "rings.h"

enum {
    LONE_BIT = 13,
    HERE_BIT = 14,
    FAR_BIT = 18,
    RANK_BIT,
    N_PROPOSED = 16,
    SEARCHED = 400, /* nodes to look at: for the next one, for the way to it, for vertices near it */
    REMEMBERED = 120,
    NEAR = 40,
    JUST_BEFORE = 4, /* the latest vertices are related to nothing */
    RELATED_BACK = 4,
    RELATED_STEPS = 4,
    MOST_RELATIONS = 6,
    MOST_WAYS = 12,
    LARGEST_RANKED = 65536,
    MOST_BESIDE = 8, /* neighbours of a proposal that are looked at */
    LARGEST_RING = 15,
    N_MODELS = 5,
    MOST_REPEATS = 5,
    MOST_TURN = 5,
    /* Numbers of sources: models, then relations, then neighbours by turn and size of the ring. */
    FIRST_RELATED = N_MODELS * 2 * (MOST_REPEATS + 1),
    FIRST_NEIGHBOUR = FIRST_RELATED + RELATED_BACK * RELATED_STEPS * 8,
    MOST_SOURCES = N_MODELS * 2 + RELATED_BACK * RELATED_STEPS * MOST_RELATIONS * MOST_WAYS,
};

typedef struct {
    int32_t node, n_sources, first_source, last_source, total;
} Proposal;

/* Who proposed a node, and the next one that did, or -1. */
typedef struct {
    int32_t source, next;
} Source;

/* The paths that were taken last in a context, and how often each came again. */
typedef struct {
    int32_t path[2], repeats[2];
} Steps;

/* Ends of the ways of one relation, for each of its steps. */
typedef struct {
    int32_t n[RELATED_STEPS], ends[RELATED_STEPS][MOST_WAYS];
} Relation;

typedef struct {
    Mixer *m;
    Rings r;
    int32_t n_nodes, n_relations, n_numbered, lone;
    int32_t *number, *nodes; /* vertex of each node, and node of each vertex */
    int32_t node, origin, outcome;
    int32_t paths[4]; /* of the last nodes, the oldest first */
    int32_t n_paths, n_steps;
    int32_t (*prefixes)[2]; /* of each path from 1 on: the path before its last turn, and that */
    Steps *steps;
    int64_t contexts[N_MODELS][2];
    Relation related[RELATED_BACK][MOST_RELATIONS];
    int32_t n_related[RELATED_BACK], latest; /* row of the latest vertex */
    int32_t *trust;                          /* of each source: right << 8 | wrong, or 0 */
    int32_t *slot, n_proposals, n_entries;
    Proposal *proposals;
    Source *sources;
    int32_t chosen[N_PROPOSED + 1];
} Order;

static Order *take_order(Room *room, const Mixer *m, int32_t n_nodes, int32_t n_faces,
                         int32_t n_relations) {
    const int64_t n = n_nodes;
    Order *o = TAKE(room, Order, 1);
    int32_t *number = TAKE(room, int32_t, n), *nodes = TAKE(room, int32_t, n);
    const int64_t n_keys = m ? (int64_t)m->n_slots : 0;
    void *prefixes = TAKE(room, int32_t, 2 * (n_keys + 1));
    Steps *steps = TAKE(room, Steps, n_keys + 1);
    int32_t *trust = TAKE(room, int32_t, FIRST_NEIGHBOUR + (MOST_TURN + 1) * (n + 1));
    int32_t *slot = TAKE(room, int32_t, n);
    Proposal *proposals = TAKE(room, Proposal, n + MOST_SOURCES);
    Source *sources = TAKE(room, Source, n + MOST_SOURCES);
    if (!o) return 0;
    take_rings(&o->r, room, n, n_faces);
    o->n_nodes = n_nodes;
    o->n_relations = n_relations;
    o->number = number;
    o->nodes = nodes;
    o->prefixes = prefixes;
    o->steps = steps;
    o->trust = trust;
    o->slot = slot;
    o->proposals = proposals;
    o->sources = sources;
    o->node = o->origin = NOWHERE;
    o->outcome = N_PROPOSED;
    return o;
}

/* Begin to number, once there are rings. */
static void begin_order(Order *o, Mixer *m) {
    o->m = m;
    for (int32_t v = 0; v < o->n_nodes; v++) o->number[v] = -1;
}

/* Give a pair of numbers a number of its own, from 1; 0 if the table is full. */
static int32_t interned(Order *o, int tag, int32_t high, int32_t low) {
    int64_t *found = value_of(o->m, (uint64_t)tag | (uint64_t)high << 5, (uint64_t)low);
    if (o->m->c.at.status) return 0;
    if (!*found) {
        *found = ++o->n_paths;
        o->prefixes[*found][0] = high;
        o->prefixes[*found][1] = low;
    }
    return (int32_t)*found;
}

/* Walk along a path from the latest node. */
static int32_t follow_path(Order *o, int32_t path) {
    int32_t n = 0, *turns = o->r.turns;
    for (int32_t p = path; p; p = o->prefixes[p][0]) n++;
    for (int32_t i = n; path; path = o->prefixes[path][0]) turns[--i] = o->prefixes[path][1];
    return follow(&o->r, o->node, o->origin, turns, n);
}

/* What a model remembers in its context, or null. */
static Steps *steps_of(Order *o, int model, int add) {
    const int64_t *context = o->contexts[model];
    const uint64_t tag = TAG_STEPS | (uint64_t)model << 5 | (uint64_t)context[0] << 8;
    int64_t *found = value_of(o->m, tag, (uint64_t)context[1]);
    if (o->m->c.at.status || (!*found && !add)) return 0;
    if (!*found) *found = ++o->n_steps;
    return o->steps + *found;
}

static void remember(Order *o, int model, int32_t path) {
    Steps *s = steps_of(o, model, 1);
    if (!s) return;
    if (s->path[0] == path) {
        s->repeats[0]++;
        return;
    }
    const int32_t repeats = s->path[1] == path ? s->repeats[1] + 1 : 0;
    s->path[1] = s->path[0];
    s->repeats[1] = s->repeats[0];
    s->path[0] = path;
    s->repeats[0] = repeats;
}

/* Proposals, and how far their sources are trusted. */

/* Give the first two numbers of a source. */
static int32_t short_of(int32_t source) {
    if (source < FIRST_RELATED) return source / (MOST_REPEATS + 1);
    if (source < FIRST_NEIGHBOUR) return source;
    return FIRST_NEIGHBOUR + (source - FIRST_NEIGHBOUR) % (MOST_TURN + 1);
}

/* 1024 times the logarithm of 1 / its share of wrong proposals. */
static int32_t trust_of(const Order *o, int32_t source) {
    const int32_t counts = o->trust[source];
    if (!counts) return o->m->trusts[2];
    return o->m->trusts[(counts >> 8) + (counts & 255)] - o->m->trusts[counts & 255];
}

/* Note a source that proposes a node, if that is free. */
static void propose(Order *o, int32_t node, int32_t source) {
    if (node == NOWHERE || o->number[node] >= 0) return;
    const int32_t entry = o->n_entries++, trust = trust_of(o, source);
    o->sources[entry] = (Source){source, -1};
    Proposal *p = o->proposals + o->slot[node];
    if (o->slot[node] >= o->n_proposals || p->node != node) {
        o->slot[node] = o->n_proposals;
        o->proposals[o->n_proposals++] = (Proposal){node, 1, entry, entry, trust};
        return;
    }
    o->sources[p->last_source].next = entry;
    p->last_source = entry;
    p->n_sources++;
    p->total += trust;
}

/* List free nodes and the sources that propose each. */
static void list_proposals(Order *o) {
    o->n_proposals = o->n_entries = 0;
    if (o->node < 0) return;
    const int32_t n_around = degree(&o->r, o->node), *h = o->paths;
    const int32_t start = place_in(&o->r, o->node, o->origin) + 1;
    int32_t taken = 0;
    for (int32_t turn = 0; turn < n_around; turn++) {
        const int32_t there = neighbour(&o->r, o->node, (start + turn) % n_around);
        taken = interned(o, TAG_TAKEN, taken, o->number[there] >= 0);
    }
    const int32_t older = interned(o, TAG_PAIR, h[0], h[1]), newer = interned(o, TAG_PAIR, h[2], h[3]);
    const int32_t contexts[N_MODELS][2] = {
        {0, h[3]}, {h[2], h[3]}, {older, newer}, {0, taken}, {taken, h[3]}};
    for (int model = 0; model < N_MODELS; model++) {
        o->contexts[model][0] = contexts[model][0];
        o->contexts[model][1] = contexts[model][1];
        const Steps *s = steps_of(o, model, 0);
        for (int place = 0; s && place < 2; place++) {
            if (!s->path[place]) continue;
            const int32_t repeats = (int32_t)least(s->repeats[place], MOST_REPEATS);
            const int32_t source = (2 * model + place) * (MOST_REPEATS + 1) + repeats;
            propose(o, follow_path(o, s->path[place]), source);
        }
    }
    for (int32_t turn = 0; turn < n_around; turn++) {
        const int32_t there = neighbour(&o->r, o->node, (start + turn) % n_around);
        const int32_t kind = (MOST_TURN + 1) * n_around + (int32_t)least(turn, MOST_TURN);
        propose(o, there, FIRST_NEIGHBOUR + kind);
    }
    for (int32_t back = 0; back < RELATED_BACK; back++) {
        const int32_t row = (o->latest + back) % RELATED_BACK;
        for (int32_t i = 0; i < o->n_related[row]; i++)
            for (int32_t step = 0; step < RELATED_STEPS; step++) {
                const Relation *relation = o->related[row] + i;
                const int32_t source = FIRST_RELATED + (RELATED_STEPS * back + step) * 8 + i;
                for (int32_t j = 0; j < relation->n[step]; j++)
                    propose(o, relation->ends[step][j], source);
            }
    }
}

/* Count for every source of every proposal whether it was right. */
static void judge(Order *o, int32_t node) {
    for (const Proposal *p = o->proposals; p < o->proposals + o->n_proposals; p++)
        for (int32_t entry = p->first_source; entry >= 0; entry = o->sources[entry].next) {
            int32_t *counts = o->trust + o->sources[entry].source;
            int32_t right = *counts ? *counts >> 8 : 1, wrong = *counts ? *counts & 255 : 1;
            if (p->node == node)
                right++;
            else
                wrong++;
            if (right + wrong > MOST_TRUSTED) {
                right = (right + 1) / 2;
                wrong = (wrong + 1) / 2;
            }
            *counts = right << 8 | wrong;
        }
}

/* List the most trusted proposals, the most trusted first, ties as they came; their number. */
static int32_t choose_likeliest(Order *o) {
    int32_t strengths[N_PROPOSED + 1], n = 0;
    for (int32_t i = 0; i < o->n_proposals; i++) {
        const int32_t strength = o->proposals[i].total;
        int32_t place = n;
        for (; place > 0 && strengths[place - 1] < strength; place--) {
            strengths[place] = strengths[place - 1];
            o->chosen[place] = o->chosen[place - 1];
        }
        strengths[place] = strength;
        o->chosen[place] = i;
        if (n < N_PROPOSED) n++;
    }
    return n;
}

static void set_here_contexts(Order *o, int64_t place, const Proposal *p) {
    const int64_t strength = least(15, 3 * (int64_t)p->total / 1024);
    const int32_t size = degree(&o->r, p->node);
    int32_t best = 0, highest = -1, n_taken = 0;
    for (int32_t place = 0; place < least(size, MOST_BESIDE); place++)
        n_taken += o->number[neighbour(&o->r, p->node, place)] >= 0;
    for (int32_t entry = p->first_source; entry >= 0; entry = o->sources[entry].next) {
        const int32_t source = o->sources[entry].source, trust = trust_of(o, source);
        if (trust <= highest) continue;
        best = source;
        highest = trust;
    }
    const int64_t outcome = least(o->outcome, 4), name = short_of(best);
    set_context(o->m, 0, 0, best);
    set_context(o->m, 1, 0, (int64_t)p->n_sources << 16 | place << 8 | strength);
    set_context(o->m, 2, 0, name << 16 | place << 8 | outcome);
    set_context(o->m, 3, 0, n_taken << 8 | least(size, LARGEST_RING));
    set_context(o->m, 4, 0, strength << 8 | n_taken);
}

static int is_free(const Order *o, int32_t node) {
    return o->number[node] < 0 && degree(&o->r, node);
}

/* Code a free node, wherever it is. */
static int32_t code_anywhere(Order *o, int32_t node) {
    const int is_ranked = o->n_nodes <= LARGEST_RANKED;
    int64_t count = is_ranked ? 0 : o->n_nodes, place = is_ranked ? 0 : node;
    for (int32_t v = 0; is_ranked && v < o->n_nodes; v++)
        if (is_free(o, v)) {
            count++;
            place += v < node;
        }
    place = code_bits(&o->m->c, count ? log_2((uint64_t)count) + 1 : 0, place);
    if (!is_ranked) return place < o->n_nodes && is_free(o, (int32_t)place) ? (int32_t)place : NOWHERE;
    for (int32_t v = 0; v < o->n_nodes; v++)
        if (is_free(o, v) && !place--) return v;
    return NOWHERE;
}

/* Code a node that was not proposed: how many free ones are nearer, if it is near. */
static int32_t code_unproposed(Order *o, int32_t node) {
    Mixer *m = o->m;
    const int32_t goal = m->c.at.reads ? NOWHERE : node, *around = o->r.around;
    const int32_t n = o->node < 0 ? 0 : search(&o->r, o->node, o->origin, SEARCHED, goal);
    set_context(m, 0, 0, 0);
    if (code_bit(m, FAR_BIT, 0, 1, !n || around[n - 1] != goal)) return code_anywhere(o, node);
    int64_t rank = 0;
    for (int32_t i = 0; goal >= 0 && i < n - 1; i++) rank += is_free(o, around[i]);
    set_context(m, 0, 0, 0);
    rank = code_number(m, RANK_BIT, 1, rank);
    for (int32_t i = 0; i < n; i++)
        if (is_free(o, around[i]) && !rank--) return around[i];
    return NOWHERE;
}

/* What is learned from each step. */

/* Give the next number to a node, without relations. */
static void number_next(Order *o, int32_t node) {
    o->number[node] = o->n_numbered;
    o->nodes[o->n_numbered++] = node;
    o->latest = (o->latest + RELATED_BACK - 1) % RELATED_BACK;
    o->n_related[o->latest] = 0;
}

/* List the ends of ways to vertices near a node, walked from vertices of neighbouring numbers. */
static void relate(Order *o) {
    static const int32_t steps[RELATED_STEPS] = {1, -1, 2, -2};
    Rings *r = &o->r;
    const int32_t n = o->n_numbered - 1;
    const int32_t n_around = search(r, o->node, o->origin, NEAR, NOWHERE);
    for (int32_t place = 0; place < n_around; place++) {
        const int32_t number = o->number[r->around[place]];
        if (number < 0 || number >= n - JUST_BEFORE) continue;
        const int32_t length = path_along(r, NOWHERE, way_back(r, place), 1);
        Relation *relation = o->related[o->latest] + o->n_related[o->latest];
        for (int step = 0; step < RELATED_STEPS; step++) {
            const int32_t other = number + steps[step];
            const int32_t base = other >= 0 ? o->nodes[other] : NOWHERE;
            const int32_t ways = base < 0 ? 0 : (int32_t)least(degree(r, base), MOST_WAYS);
            relation->n[step] = ways;
            for (int32_t i = 0; i < ways; i++)
                relation->ends[step][i] = follow(r, base, neighbour(r, base, i), r->turns, length);
        }
        if (++o->n_related[o->latest] == o->n_relations) return;
    }
}

/* Give the next number to a node, and learn from its place. */
static void go_to(Order *o, int32_t node) {
    Rings *r = &o->r;
    int32_t path = 0, origin = NOWHERE;
    if (o->node >= 0) {
        const int32_t n = search(r, o->node, o->origin, REMEMBERED, node);
        if (r->around[n - 1] == node) {
            const int32_t length = way_back(r, n - 1);
            origin = r->way[1];
            const int32_t n_turns = path_along(r, o->origin, length, 0);
            for (int32_t i = 0; i < n_turns; i++)
                path = interned(o, TAG_PATH, path, r->turns[i]);
            for (int model = 0; model < N_MODELS; model++) remember(o, model, path);
        }
    }
    if (origin == NOWHERE) origin = neighbour(r, node, 0);
    for (int i = 0; i < 3; i++) o->paths[i] = o->paths[i + 1];
    o->paths[3] = path;
    o->node = node;
    o->origin = origin;
    number_next(o, node);
    if (o->n_relations) relate(o);
}

/* Code which node the next vertex is. */
static int32_t code_vertex(Order *o, int32_t node) {
    Mixer *m = o->m;
    while (o->lone < o->n_nodes && degree(&o->r, o->lone)) o->lone++;
    if (o->lone < o->n_nodes) {
        const int is_lone = !m->c.at.reads && (node >= o->n_nodes || !degree(&o->r, node));
        set_context(m, 0, 0, 0);
        if (code_bit(m, LONE_BIT, 0, 1, is_lone)) {
            number_next(o, o->lone);
            return o->lone++;
        }
    }
    list_proposals(o);
    const int32_t n_likeliest = choose_likeliest(o);
    int32_t found = NOWHERE, outcome = N_PROPOSED;
    for (int32_t place = 0; place < n_likeliest && found < 0; place++) {
        const Proposal *p = o->proposals + o->chosen[place];
        set_here_contexts(o, place, p);
        if (!code_bit(m, HERE_BIT + (int)least(place, 3), 0, 5, p->node == node)) continue;
        found = p->node;
        outcome = place;
    }
    o->outcome = outcome;
    if (found == NOWHERE) found = code_unproposed(o, node);
    if (found == NOWHERE || m->c.at.status) {
        fail(&m->c, NO_NODE);
        return NOWHERE;
    }
    judge(o, found);
    go_to(o, found);
    return found;
}

#endif
