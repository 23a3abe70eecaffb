#include <math.h>

/* --- arrays and records of the compiled chain ----------------------------------------------- */

/* @TYPES@ */
/* What a command's signals are, and which conditions have to be known. */
typedef struct {
    int size_drawn, size_own, joint, rate, acceleration, direction, travel, payload, centre, time;
    int temperature, temperatures, needs_payload, needs_centre;
    Wholes needs_temperature;
    double moment;
} Given;

static void idle(double *w) { (void)w; }

/* --- laws, and the numbers of this machine --------------------------------------------------- */

/* @MACHINE@ */
/* --- the compiled chain, from the package's source ------------------------------------------- */

/* @CHAIN@ */
/* --- one command ----------------------------------------------------------------------------- */

/* Scratch in the room that the caller keeps; behind it signals, target, correction, what is told. */
static double *placed(double *next, CommandRoom *scratch) {
/* @PLACES@ */
}

static void fill_signals(const conditions *at, double *signals) {
    for (int i = 0; i < CORRECT_JOINTS; i++) {
        signals[given.rate + i] = at->rate[i];
        signals[given.acceleration + i] = at->acceleration[i];
        signals[given.direction + i] = at->direction[i];
        signals[given.travel + i] = INFINITY; /* play is crossed by the correction itself */
    }
    signals[given.time] = given.moment;
    signals[given.payload] = at->payload;
    for (int i = 0; i < 3; i++) signals[given.centre + i] = at->payload_centre[i];
#if CORRECT_TEMPERATURES
    for (int i = 0; i < CORRECT_TEMPERATURES; i++)
        signals[given.temperature + i] = at->temperature[i];
#endif
}

/* Whether all that the machine's effects need of the conditions is known. */
static int all_known(const conditions *at) {
    if (given.needs_payload && !isfinite(at->payload)) return 0;
    for (int i = 0; given.needs_centre && i < 3; i++)
        if (!isfinite(at->payload_centre[i])) return 0;
#if CORRECT_TEMPERATURES
    for (int i = 0; i < given.needs_temperature.n; i++)
        if (!isfinite(at->temperature[given.needs_temperature.at[i]])) return 0;
#endif
    return 1;
}

void conditions_at_rest(conditions *at) {
    for (int i = 0; i < CORRECT_JOINTS; i++)
        at->rate[i] = at->acceleration[i] = at->direction[i] = 0.0;
    at->time = 0.0;
    at->payload = at->payload_centre[0] = at->payload_centre[1] = at->payload_centre[2] = NAN;
#if CORRECT_TEMPERATURES
    for (int i = 0; i < CORRECT_TEMPERATURES; i++) at->temperature[i] = NAN;
#endif
}

/* Give the scratch of a machine its constants and dimensions. */
static void begin_machine(const MachineRecord *me, const Place *own) {
    const Limbs *limbs = &me->body.limbs;
    const Opening *opening = &me->body.opening;
    const Rows work = own->state.room.work;
    for (int limb = 0; limb < work.n; limb++)
        for (int i = 0; i < limbs->consts.width; i++)
            work.at[limb * work.width + limbs->at.at[CONSTANTS_AT] + i] =
                limbs->consts.at[limb * limbs->consts.width + i];
    for (int i = 0; i < opening->constants.n; i++)
        own->state.opening.at[opening->at.at[2] + i] = opening->constants.at[i];
    copied(own->state.drive, me->stages.drive.work);
    copied(own->state.structure, me->stages.structure.work);
    chain_take_dimensions(&me->body, me->g, &own->state);
}

void correct_begin(double *room) {
    CommandRoom scratch;
    for (int i = 0; i < CORRECT_ROOM; i++) room[i] = 0.0;
    placed(room, &scratch);
    begin_machine(&drawn, &scratch.drawn);
    begin_machine(&own, &scratch.own);
    for (int i = 0; i < scratch.task.n; i++) scratch.task.at[i * scratch.task.width + i] = 1.0;
}

int correct_in(double *room, const double *q, const conditions *at, double *out) {
    conditions nothing_known;
    CommandRoom scratch;
    double *signals = placed(room, &scratch);
    const Numbers told = {q, CORRECT_JOINTS, 1};
    const Rows target = {signals + given.size_own, TARGET, 1};
    const Rows dq = {target.at + TARGET, CORRECT_JOINTS, 1}, said = {dq.at + CORRECT_JOINTS, 4, 1};
    int code, known;
    if (!at) {
        conditions_at_rest(&nothing_known);
        at = &nothing_known;
    }
    known = all_known(at);
    fill_signals(at, signals);
    code = chain_commanded(&drawn, &own, &guards, &search, told,
                           (Numbers){signals, given.size_own, 1}, at->payload,
                           (Numbers){at->payload_centre, 3, 1}, known, target, dq, said, &scratch);
    if (code == CORRECT_PASSED && !known) code = CORRECT_MISSING_CONDITION;
    for (int i = 0; i < CORRECT_JOINTS; i++) out[i] = q[i] + dq.at[i];
    return code;
}

int correct(const double *q, const conditions *at, double *out) {
    static double room[CORRECT_ROOM];
    static int begun = 0;
    if (!begun) {
        correct_begin(room);
        begun = 1;
    }
    return correct_in(room, q, at, out);
}
