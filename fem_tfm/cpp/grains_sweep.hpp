// SPDX-License-Identifier: LGPL-3.0-or-later
// Steps of all blocks by a team of threads. Included by grains_step.cpp alone.
#pragma once

// All threads of the team wait for each other: they spin for some microseconds, then sleep, since the
// processor may be busy with the thread that is waited for. The last one does something first.
constexpr int SPINS = 2000;

template <class Action>
INLINE void meet_all(State& s, int team, Action action) {
    if (team == 1) return action();
    const int phase = __atomic_load_n(&s.phase, __ATOMIC_ACQUIRE);
    if (__atomic_add_fetch(&s.arrived, 1, __ATOMIC_ACQ_REL) == team) {
        action();
        __atomic_store_n(&s.arrived, 0, __ATOMIC_RELAXED);
        __atomic_store_n(&s.phase, phase + 1, __ATOMIC_SEQ_CST);
#if defined(__linux__)
        if (__atomic_load_n(&s.asleep, __ATOMIC_SEQ_CST) > 0)
            syscall(SYS_futex, &s.phase, FUTEX_WAKE_PRIVATE, team, nullptr, nullptr, 0);
#endif
        return;
    }
    for (int k = 0; k < SPINS; ++k) {
        if (__atomic_load_n(&s.phase, __ATOMIC_ACQUIRE) != phase) return;
#if defined(__SSE2__)
        __builtin_ia32_pause();
#endif
    }
    __atomic_add_fetch(&s.asleep, 1, __ATOMIC_SEQ_CST);
    while (__atomic_load_n(&s.phase, __ATOMIC_SEQ_CST) == phase) {
#if defined(__linux__)
        syscall(SYS_futex, &s.phase, FUTEX_WAIT_PRIVATE, phase, nullptr, nullptr, 0);
#endif
    }
    __atomic_sub_fetch(&s.asleep, 1, __ATOMIC_SEQ_CST);
}

// Largest distance that one of some grains has moved since the list was made.
INLINE double moved(const State& s, int from, int to) {
    double top = 0.0;
    for (int i = from; i < to; ++i) {
        double square = 0.0;
        for (int k = 0; k < 3; ++k) {
            const double d = s.x[4 * i + k] - s.origin[4 * i + k];
            square += d * d;
        }
        if (square > top) top = square;
    }
    return __builtin_sqrt(top);
}

// Room of a thread, laid out.
INLINE Bench lay(const State& s, int me, std::size_t pushes, int pairs) {
    double* p = s.bench[me] + pushes;
    int* q = (int*)(p + 5 * std::ptrdiff_t(pairs));
    return {s.bench[me], p, p + pairs, p + 2 * pairs, p + 3 * pairs, p + 4 * pairs, q, q + pairs, q + 2 * pairs};
}

// Where share t keeps the pushes of the block that moves late as number k.
template <bool ROLL>
INLINE double* late_room(const State& s, int t, int k) {
    return s.bench[t] + std::ptrdiff_t(PUSH<ROLL>) * (BLOCK + s.spill_room + PAD) * (k + 1);
}

// Contacts of a share, and the motion of what no other share pushes or sees.
template <int KIND, bool MONO, bool ROLL>
INLINE void work(State& s, int t, std::int64_t& met) {
    const Bench bench = lay(s, t, s.bench_pushes, s.bench_pairs);
    double top = 0.0;
    for (int b = s.cut[t]; b < s.cut[t + 1]; ++b) {
        Bench mine = bench;
        const int number = b - s.cut[t];
        if (number < s.late[t]) mine.push = late_room<ROLL>(s, t, number);
        contacts<KIND, MONO, ROLL>(s, b, mine, met);
        if (number < s.late[t]) continue;
        const double square = move<KIND, ROLL>(s, b, mine.push);
        if (!(square <= top)) top = square;
    }
    s.speed[t] = top;
}

template <int KIND, bool ROLL>
INLINE void work_late(State& s, int t) {
    for (int k = 0; k < s.late[t]; ++k) {
        const double square = move<KIND, ROLL>(s, s.cut[t] + k, late_room<ROLL>(s, t, k));
        if (!(square <= s.speed[t])) s.speed[t] = square;
    }
}

// End of a step: whether the list still holds.
inline void conclude(State& s) {
    double square = 0.0;
    for (int t = 0; t < s.threads; ++t)
        if (!(s.speed[t] <= square)) square = s.speed[t];
    s.fastest = __builtin_sqrt(square);
    const double stride = s.fastest * s.dt;
    s.travelled += stride;
    ++s.steps;
    // measured where the bound is reached; the next step must not pass the limit either
    if (!(s.travelled <= 0.5 * s.skin)) s.travelled = moved(s, 0, s.n);
    if (!(s.travelled + stride <= 0.5 * s.skin)) s.fresh = 0;
}

// Every thread calls it. A team smaller than the shares takes several shares each.
template <int KIND, bool MONO, bool ROLL>
void step_on(State& s, int steps, int me, int team) {
    std::int64_t met = 0;
    if (steps == 0 && !s.fresh) rebuild(s, PUSH<ROLL>);
    for (int step = 0; step < steps; ++step) {
        if (!s.fresh) rebuild(s, PUSH<ROLL>);
        if (s.failed) return;
        for (int t = me; t < s.threads; t += team) work<KIND, MONO, ROLL>(s, t, met);
        meet_all(s, team, [] {});
        for (int t = me; t < s.threads; t += team) work_late<KIND, ROLL>(s, t);
        meet_all(s, team, [&] { conclude(s); });
    }
#pragma omp atomic
    s.contacts += met;
}

template <int KIND, bool MONO, bool ROLL>
void team_up(State& s, int steps) {
#if defined(_OPENMP)
#pragma omp parallel num_threads(s.threads)
    step_on<KIND, MONO, ROLL>(s, steps, omp_get_thread_num(), omp_get_num_threads());
#else
    step_on<KIND, MONO, ROLL>(s, steps, 0, 1);
#endif
}

template <int KIND>
void choose(State& s, int steps) {
    // what is not taken often is compiled for the general case only
    if (s.rolling) team_up<KIND, false, true>(s, steps);
    else if (s.mono && KIND != HERTZ) team_up<KIND, KIND != HERTZ, false>(s, steps);
    else team_up<KIND, false, false>(s, steps);
}

void start(State& s, int steps) {
    if (s.law_kind == VISCOUS) choose<VISCOUS>(s, steps);
    else if (s.law_kind == SPRING) choose<SPRING>(s, steps);
    else choose<HERTZ>(s, steps);
}
