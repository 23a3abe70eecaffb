#include <math.h>

/* --- arrays and structures: of the compiled chain, field by field -------------------------- */

typedef void (*Law)(double *);

typedef struct { const double *at; int n, width; } Numbers; /* n rows of a width */
typedef struct { const int *at; int n, width; } Wholes;
typedef struct { const Law *at; int n, width; } Laws;

enum { Q_AT, X_AT, G_AT, C_AT, F_AT, F_X_AT, F_Q_AT, F_G_AT, SHARED_FROM, SHARED_TO };
enum { SETUP, SHARED, NEAR, FULL }; /* NEAR has derivatives by the pose alone here */
enum { OF_JOINTS, OF_POSE, OF_DIMENSIONS, OF_CLOSURES, OF_TASK };
/* @CONSTANTS@ */
enum { S_AT, S_COUNT, V_AT, V_COUNT, O_AT, O_COUNT, W_AT, W_SIZE, T_F_AT, SPAN };

/* Closures: which limb takes which joints, dimensions and rows, all of one law. */
typedef struct {
    Laws law;
    Wholes at, joints, params, rows;
    Numbers consts, fixed;
    Wholes sizes;
    Numbers most;
} Limbs;

/* What is carried and where. */
typedef struct {
    Laws point;
    Wholes point_at;
    Laws mass;
    Wholes mass_at, dims;
    Numbers kg, moves, home;
    double pretension;
    Numbers constants;
    Wholes joints;
} Bearing;

/* A pose near the wanted assembly mode, where a law says it. */
typedef struct {
    Laws law;
    Wholes at, joints, dims;
    Numbers constants;
} Opening;

typedef struct {
    Limbs limbs;
    int size;
    Bearing bearing;
    Opening opening;
    Numbers home;
    int stages;
} Body;

/* Terms of effects: each a law, what it takes and where it adds. */
typedef struct {
    Laws law;
    Wholes span, signal, value, output;
    Numbers work;
} Table;

typedef struct {
    Table drive, structure;
    int asked, stands;
    Wholes at;
} Stages;

typedef struct {
    Numbers tool;
    Wholes axes;
    int turns;
    double arm;
} Aimed;

typedef struct {
    Body body;
    Stages stages;
    Numbers g, theta;
    Aimed aim;
    int by_pose, reshaped, exact;
    double stray;
} Machine;

typedef struct {
    Numbers planes, lower, upper, least, most;
    double condition, typical, margin, on_face, correction, reached, stepped;
    int pulls;
} Guards;

typedef struct {
    double bound, tolerance;
    int iterations, halvings;
} Search;

/* What a command's signals are, and which conditions have to be known. */
typedef struct {
    int size_drawn, size_own, joint, rate, acceleration, direction, travel, payload, centre, time;
    int temperature, temperatures, needs_payload, needs_centre;
    Wholes needs_temperature;
} Given;

static inline double larger(double a, double b) { return b > a ? b : a; }
static inline double smaller(double a, double b) { return b < a ? b : a; }
static void idle(double *w) { (void)w; }

/* @MACHINE@ */

/* --- scratch: places in the room that the caller keeps ------------------------------------- */

typedef struct {
    double *work, *f, *by_x, *by_q, *system, *step, *way;
    int size, width; /* of a limb's workspace; of a row of `system` */
} Room;

typedef struct {
    double *point, *mass, *u_x, *by_q, *by_g, *accelerated, *gravity, *inertia, *load;
    double *pull, *pull_home, *there, *way, *u_q, *still, *origin;
} Carried;

typedef struct {
    Room room;
    Carried carried;
    double *opening, *drive, *structure, *joint, *geometry, *before;
} State;

typedef struct {
    State state;
    double *point, *place, *slope, *by_q, *x, *signals, *normal, *dq, *step, *there;
    int count, width; /* coordinates of a place; of a row of `normal` */
    int near;
} Place;

typedef struct {
    Place drawn, own;
    double *signals, *signals_own, *centre, *origin, *task, *by_q, *told, *target, *dq;
} CommandRoom;

static int most_of(int a, int b) { return a > b ? a : b; }

static double *take(double **next, int count) {
    double *taken = *next;
    *next += count;
    return taken;
}

static void take_room(const Body *b, double **next, Room *r) {
    const int *n = b->limbs.sizes.at;
    const int wide = most_of(n[OF_POSE], most_of(n[OF_CLOSURES], n[OF_JOINTS] + n[OF_POSE]));
    r->size = b->size;
    r->width = wide + most_of(n[OF_JOINTS], most_of(n[OF_POSE], SIDES));
    r->work = take(next, b->limbs.joints.n * b->size);
    r->f = take(next, n[OF_CLOSURES]);
    r->by_x = take(next, n[OF_CLOSURES] * n[OF_POSE]);
    r->by_q = take(next, n[OF_CLOSURES] * n[OF_JOINTS]);
    r->system = take(next, wide * r->width);
    r->step = take(next, wide);
    r->way = take(next, n[OF_JOINTS]);
}

static void take_carried(const Body *b, double **next, Carried *c) {
    const int *n = b->limbs.sizes.at;
    c->point = take(next, b->bearing.point_at.at[5]);
    c->mass = take(next, most_of(1, b->bearing.mass_at.at[6]));
    c->u_x = take(next, n[OF_POSE]);
    c->by_q = take(next, n[OF_JOINTS]);
    c->by_g = take(next, n[OF_DIMENSIONS]);
    c->accelerated = take(next, 3 * (b->bearing.kg.n + 1));
    c->gravity = take(next, n[OF_JOINTS]);
    c->inertia = take(next, n[OF_JOINTS]);
    c->load = take(next, n[OF_DIMENSIONS]);
    c->pull = take(next, n[OF_CLOSURES]);
    c->pull_home = take(next, n[OF_CLOSURES]);
    c->there = take(next, n[OF_POSE]);
    c->way = take(next, n[OF_JOINTS]);
    c->u_q = take(next, n[OF_JOINTS]);
    c->still = take(next, n[OF_JOINTS]);
    c->origin = take(next, 3);
}

static void take_place(const Machine *me, int signals, double **next, Place *p) {
    const int *n = me->body.limbs.sizes.at;
    const int count = me->aim.axes.n + (me->aim.turns ? 9 : 0);
    const int wide = most_of(count, most_of(n[OF_POSE], n[OF_JOINTS])) + 1;
    State *s = &p->state;
    take_room(&me->body, next, &s->room);
    take_carried(&me->body, next, &s->carried);
    s->opening = take(next, me->body.opening.law.n ? me->body.opening.at.at[4] : 1);
    s->drive = take(next, me->stages.drive.work.n);
    s->structure = take(next, me->stages.structure.work.n);
    s->joint = take(next, n[OF_JOINTS]);
    s->geometry = take(next, n[OF_DIMENSIONS]);
    s->before = take(next, n[OF_POSE]);
    p->count = count;
    p->width = wide + 1;
    p->point = take(next, me->body.bearing.point_at.at[5]);
    p->place = take(next, count);
    p->slope = take(next, count * n[OF_POSE]);
    p->by_q = take(next, count * n[OF_JOINTS]);
    p->x = take(next, n[OF_POSE]);
    p->signals = take(next, signals);
    p->normal = take(next, wide * p->width);
    p->dq = take(next, n[OF_JOINTS]);
    p->step = take(next, wide + n[OF_CLOSURES]);
    p->there = take(next, n[OF_JOINTS]);
    p->near = 0;
}

static void take_command_room(double *first, CommandRoom *r) {
    const int *n = drawn.body.limbs.sizes.at;
    double *next = first;
    take_place(&drawn, given.size_drawn, &next, &r->drawn);
    take_place(&own, given.size_own, &next, &r->own);
    r->signals = take(&next, given.size_drawn);
    r->signals_own = take(&next, given.size_own);
    r->centre = take(&next, drawn.body.bearing.point_at.at[5]);
    r->origin = take(&next, 3);
    r->task = take(&next, n[OF_TASK] * n[OF_POSE]);
    r->by_q = take(&next, n[OF_TASK] * n[OF_JOINTS]);
    r->told = take(&next, n[OF_JOINTS]);
    r->target = take(&next, r->drawn.count);
    r->dq = take(&next, n[OF_JOINTS]);
}

/* --- the closures of a mechanism ----------------------------------------------------------- */

static void copy_into(double *values, const double *source, int count) {
    for (int i = 0; i < count; i++) values[i] = source[i];
}

/* Solve `size` equations for the right sides behind them, in place; 0 if singular. */
static int solve(double *system, int stride, int size, int sides) {
    const int width = size + sides;
    for (int k = 0; k < size; k++) {
        int best = k;
        for (int i = k + 1; i < size; i++)
            if (fabs(system[i * stride + k]) > fabs(system[best * stride + k])) best = i;
        if (!(fabs(system[best * stride + k]) > 0.0)) return 0; /* zero or not a number */
        if (best != k)
            for (int j = k; j < width; j++) {
                const double held = system[k * stride + j];
                system[k * stride + j] = system[best * stride + j];
                system[best * stride + j] = held;
            }
        const double inverse = 1.0 / system[k * stride + k];
        for (int i = k + 1; i < size; i++) {
            const double factor = system[i * stride + k] * inverse;
            if (factor != 0.0)
                for (int j = k + 1; j < width; j++)
                    system[i * stride + j] -= factor * system[k * stride + j];
        }
    }
    for (int k = size - 1; k >= 0; k--) {
        const double inverse = 1.0 / system[k * stride + k];
        for (int side = size; side < width; side++) {
            double total = system[k * stride + side];
            for (int j = k + 1; j < size; j++)
                total -= system[k * stride + j] * system[j * stride + side];
            system[k * stride + side] = total * inverse;
        }
    }
    return 1;
}

static void set_geometry(const Limbs *l, const double *g, Room *room) {
    const int p = l->sizes.at[OF_DIMENSIONS];
    for (int limb = 0; limb < l->params.n; limb++) {
        double *work = room->work + limb * room->size;
        for (int i = 0; i < l->params.width; i++) {
            const int row = l->params.at[limb * l->params.width + i];
            work[l->at.at[G_AT] + i] = row < p ? g[row] : l->fixed.at[row - p];
        }
        l->law.at[SETUP](work);
    }
}

/* Evaluate the closures at joints q and pose x, at stage NEAR or FULL. */
static void place(const Limbs *l, const double *q, const double *x, int stage, Room *room) {
    const int *at = l->at.at;
    const int k = l->sizes.at[OF_POSE];
    const double *first = room->work;
    for (int limb = 0; limb < l->joints.n; limb++) {
        double *work = room->work + limb * room->size;
        for (int i = 0; i < l->joints.width; i++)
            work[at[Q_AT] + i] = q[l->joints.at[limb * l->joints.width + i]];
        copy_into(work + at[X_AT], x, k);
        if (limb == 0)
            l->law.at[SHARED](work);
        else
            for (int i = at[SHARED_FROM]; i < at[SHARED_TO]; i++) work[i] = first[i];
        l->law.at[stage](work);
        for (int i = 0; i < l->rows.width; i++) {
            const int row = l->rows.at[limb * l->rows.width + i];
            room->f[row] = work[at[F_AT] + i];
            copy_into(room->by_x + row * k, work + at[F_X_AT] + i * k, k);
        }
    }
}

/* Put the limbs' derivatives by their joints into their places in `by_q`. */
static void spread_joints(const Limbs *l, Room *room) {
    const int count = l->joints.width, m = l->sizes.at[OF_JOINTS];
    for (int limb = 0; limb < l->joints.n; limb++)
        for (int i = 0; i < l->rows.width; i++)
            for (int j = 0; j < count; j++)
                room->by_q[l->rows.at[limb * l->rows.width + i] * m
                           + l->joints.at[limb * count + j]] =
                    room->work[limb * room->size + l->at.at[F_Q_AT] + i * count + j];
}

/* f_x^T f_x into the first columns of `system`; f_x^T f behind them where asked for. */
static void normal_equations(Room *room, int r, int k, int with_f) {
    double *system = room->system;
    const int w = room->width;
    for (int i = 0; i < k; i++) {
        double total;
        for (int j = i; j < k; j++) {
            total = 0.0;
            for (int row = 0; row < r; row++)
                total += room->by_x[row * k + i] * room->by_x[row * k + j];
            system[i * w + j] = system[j * w + i] = total;
        }
        if (!with_f) continue;
        total = 0.0;
        for (int row = 0; row < r; row++) total += room->by_x[row * k + i] * room->f[row];
        system[i * w + k] = total;
    }
}

/* Newton's step in the pose into `step`; 0 where there is none. */
static int towards(Room *room, int r, int k) {
    double *system = room->system;
    const int w = room->width;
    if (r == k) {
        for (int i = 0; i < k; i++) {
            copy_into(system + i * w, room->by_x + i * k, k);
            system[i * w + k] = room->f[i];
        }
    } else {
        normal_equations(room, r, k, 1);
    }
    if (!solve(system, w, k, 1)) return 0;
    for (int i = 0; i < k; i++) room->step[i] = system[i * w + k];
    return 1;
}

/* Whether the pose is one: no step in it would close more, nothing is torn. */
static int closed(const Limbs *l, const Room *room, double stray) {
    if (stray == INFINITY) return 1;
    const int r = l->sizes.at[OF_CLOSURES], k = l->sizes.at[OF_POSE];
    for (int row = 0; row < r; row++) {
        double missed = 0.0;
        if (r == k)
            missed = room->f[row];
        else
            for (int j = 0; j < k; j++) missed += room->by_x[row * k + j] * room->step[j];
        if (!(fabs(missed) < stray) || !(fabs(room->f[row]) <= l->most.at[row])) return 0;
    }
    return 1;
}

/* Bring the pose x to joints q, from where it is; not a number and 0 where none is. */
static int assemble(const Limbs *l, const double *q, double *x, double stray, Room *room) {
    const int r = l->sizes.at[OF_CLOSURES], k = l->sizes.at[OF_POSE];
    int good = 0;
    for (int round = 0; round < STEPS; round++) {
        place(l, q, x, NEAR, room);
        good = 0;
        if (!towards(room, r, k)) break;
        double most = 0.0;
        for (int i = 0; i < k; i++) {
            most += fabs(room->step[i]); /* not a number if one is not */
            x[i] -= room->step[i];
        }
        if (!(most < INFINITY)) break;
        good = closed(l, room, stray);
        if (most <= SETTLED_STEP) break;
    }
    if (good) return 1;
    for (int i = 0; i < k; i++) x[i] = NAN;
    return 0;
}

/* The same in stages, by joints between home, where x is a pose, and q. */
static int follow(const Body *b, const double *q, double *x, double stray, Room *room) {
    const int m = b->limbs.sizes.at[OF_JOINTS];
    for (int stage = 1; stage <= b->stages; stage++) {
        const int last = stage == b->stages;
        for (int i = 0; i < m; i++) {
            const double home = b->home.at[i];
            room->way[i] = last ? q[i] : home + (q[i] - home) * stage / b->stages;
        }
        if (!assemble(&b->limbs, room->way, x, last ? stray : INFINITY, room)) return 0;
    }
    return 1;
}

/* -by_pose f_x^+ of `count` rows of by_pose: row i of `system` holds entry i of each. */
static int back(const Limbs *l, const double *by_pose, int count, Room *room) {
    const int r = l->sizes.at[OF_CLOSURES], k = l->sizes.at[OF_POSE], w = room->width;
    double *system = room->system;
    if (r != k) normal_equations(room, r, k, 0);
    for (int i = 0; i < k; i++) {
        for (int j = 0; j < k && r == k; j++) system[i * w + j] = room->by_x[j * k + i];
        for (int side = 0; side < count; side++) system[i * w + k + side] = by_pose[side * k + i];
    }
    return solve(system, w, k, count);
}

/* Derivatives by joints, and by dimensions where `by_g` is given, of what has `by_pose`. */
static void moved(const Limbs *l, const double *by_pose, int count, Room *room, double *by_q,
                  double *by_g) {
    const int *n = l->sizes.at;
    const int r = n[OF_CLOSURES], k = n[OF_POSE], m = n[OF_JOINTS], p = n[OF_DIMENSIONS];
    const int width = room->width, each = l->joints.width, dims = l->params.width;
    const double begin = back(l, by_pose, count, room) ? 0.0 : NAN;
    for (int i = 0; i < count * m; i++) by_q[i] = begin;
    for (int i = 0; by_g && i < count * p; i++) by_g[i] = begin;
    if (begin != 0.0) return;
    for (int side = 0; side < count; side++)
        for (int limb = 0; limb < l->joints.n; limb++) {
            const double *work = room->work + limb * room->size;
            for (int i = 0; i < l->rows.width; i++) {
                const int row = l->rows.at[limb * l->rows.width + i];
                double weight = 0.0;
                if (r == k)
                    weight = -room->system[row * width + k + side];
                else
                    for (int j = 0; j < k; j++)
                        weight -= room->by_x[row * k + j] * room->system[j * width + k + side];
                for (int j = 0; j < each; j++)
                    by_q[side * m + l->joints.at[limb * each + j]] +=
                        weight * work[l->at.at[F_Q_AT] + i * each + j];
                for (int j = 0; by_g && j < dims; j++) {
                    const int column = l->params.at[limb * dims + j];
                    if (column < p)
                        by_g[side * p + column] += weight * work[l->at.at[F_G_AT] + i * dims + j];
                }
            }
        }
}

/* The step J^T (J J^T)^-1 f, or J^-1 f where J (r, count) is square. */
static int least_step(const double *slope, int r, int count, const double *f, double *system,
                      int w, double *step) {
    if (r == count) {
        for (int i = 0; i < r; i++) {
            copy_into(system + i * w, slope + i * count, r);
            system[i * w + r] = f[i];
        }
        if (!solve(system, w, r, 1)) return 0;
        for (int i = 0; i < r; i++) step[i] = system[i * w + r];
        return 1;
    }
    for (int i = 0; i < r; i++) {
        for (int j = 0; j < r; j++) {
            double total = 0.0;
            for (int u = 0; u < count; u++) total += slope[i * count + u] * slope[j * count + u];
            system[i * w + j] = total;
        }
        system[i * w + i] += 2.3e-16;
        system[i * w + r] = f[i];
    }
    if (!solve(system, w, r, 1)) return 0;
    for (int j = 0; j < count; j++) {
        double total = 0.0;
        for (int i = 0; i < r; i++) total += slope[i * count + j] * system[i * w + r];
        step[j] = total;
    }
    return 1;
}

/* --- forces -------------------------------------------------------------------------------- */

static void point_at(const Bearing *b, const double *x, int k, const double *offset,
                     double *work) {
    copy_into(work + b->point_at.at[0], x, k);
    copy_into(work + b->point_at.at[1], offset, 3);
    b->point.at[SETUP](work);
    b->point.at[SHARED](work);
    b->point.at[FULL](work);
}

static void masses_at(const Bearing *b, const double *q, const double *x, int k, double *work) {
    copy_into(work + b->mass_at.at[0], x, k);
    for (int i = 0; i < b->joints.n; i++) work[b->mass_at.at[1] + i] = q[b->joints.at[i]];
    b->mass.at[SETUP](work);
    b->mass.at[SHARED](work);
    b->mass.at[FULL](work);
}

static void set_masses(const Limbs *l, const Bearing *b, const double *g, Carried *found) {
    const int p = l->sizes.at[OF_DIMENSIONS];
    double *first = found->mass + b->mass_at.at[2];
    for (int i = 0; i < b->dims.n; i++) {
        const int row = b->dims.at[i];
        first[i] = row < p ? g[row] : l->fixed.at[row - p];
    }
    copy_into(first + b->dims.n, b->constants.at, b->constants.n);
}

/* Work of one mass against an acceleration, to u_x and u_q; point -1 is the payload. */
static void add_work(const Bearing *b, Carried *found, int k, int point, double kg,
                     const double *a) {
    for (int axis = 0; axis < 3; axis++) {
        const double force = kg * a[axis];
        if (force == 0.0) continue;
        if (point < 0) {
            for (int i = 0; i < k; i++)
                found->u_x[i] += force * found->point[b->point_at.at[3] + axis * k + i];
            continue;
        }
        const int row = 3 * point + axis;
        for (int i = 0; i < k; i++)
            found->u_x[i] += force * found->mass[b->mass_at.at[4] + row * k + i];
        for (int i = 0; i < b->joints.n; i++)
            found->u_q[b->joints.at[i]] +=
                force * found->mass[b->mass_at.at[5] + row * b->joints.n + i];
    }
}

/* u_x and u_q of all masses, under gravity or as `accelerated`. */
static void work_of(const Limbs *l, const Bearing *b, double payload, int accelerated,
                    Carried *found) {
    const int k = l->sizes.at[OF_POSE], m = l->sizes.at[OF_JOINTS], count = b->kg.n;
    for (int i = 0; i < k; i++) found->u_x[i] = 0.0;
    for (int i = 0; i < m; i++) found->u_q[i] = 0.0;
    for (int point = -1; point < count; point++) {
        const double kg = point < 0 ? payload : b->kg.at[point];
        double a[3] = {0.0, 0.0, FREE_FALL};
        if (accelerated) copy_into(a, found->accelerated + 3 * (point < 0 ? count : point), 3);
        if (accelerated && point >= 0 && b->moves.at[point] == 0.0) continue;
        add_work(b, found, k, point, kg, a);
    }
}

/* Accelerations of all masses by the second difference of their places; 0 if none move. */
static int accelerate(const Limbs *l, const Bearing *b, const double *q, const double *x,
                      const double *rate, const double *acceleration, const double *centre,
                      Room *room, Carried *found) {
    const int k = l->sizes.at[OF_POSE], m = l->sizes.at[OF_JOINTS], count = b->kg.n;
    int moving = 0;
    for (int i = 0; i < m; i++) moving = moving || rate[i] != 0.0 || acceleration[i] != 0.0;
    for (int i = 0; i < 3 * (count + 1); i++) found->accelerated[i] = 0.0;
    if (!moving) return 0;
    for (int side = -1; side <= 1; side++) {
        const double t = side * MOMENT, weight = (side == 0 ? -2.0 : 1.0) / (MOMENT * MOMENT);
        for (int i = 0; i < m; i++)
            found->way[i] = q[i] + rate[i] * t + acceleration[i] * t * t / 2;
        copy_into(found->there, x, k);
        assemble(l, found->way, found->there, STRAY, room);
        point_at(b, found->there, k, centre, found->point);
        masses_at(b, found->way, found->there, k, found->mass);
        for (int i = 0; i < 3 * count; i++)
            found->accelerated[i] += weight * found->mass[b->mass_at.at[3] + i];
        for (int i = 0; i < 3; i++)
            found->accelerated[3 * count + i] += weight * found->point[b->point_at.at[2] + i];
    }
    return 1;
}

/* Pulls of the cables that bear u_x, nearest to the pretension. */
static void pulls_of(const Limbs *l, const Bearing *b, Room *room, const Carried *found,
                     double *pull) {
    const int r = l->sizes.at[OF_CLOSURES], k = l->sizes.at[OF_POSE], w = room->width;
    double *system = room->system;
    normal_equations(room, r, k, 0);
    for (int i = 0; i < k; i++) {
        double right = -found->u_x[i];
        for (int row = 0; row < r; row++) right -= room->by_x[row * k + i] * b->pretension;
        system[i * w + k] = right;
    }
    const int good = solve(system, w, k, 1);
    for (int row = 0; row < r; row++) {
        pull[row] = good ? b->pretension : NAN;
        for (int i = 0; i < k; i++) pull[row] += room->by_x[row * k + i] * system[i * w + k];
    }
}

/* All loads that are asked for, at joints q and pose x. */
static void bear(const Limbs *l, const Bearing *b, int asked, const double *q, const double *x,
                 const double *rate, const double *acceleration, double payload,
                 const double *centre, Room *room, Carried *found) {
    const int k = l->sizes.at[OF_POSE], m = l->sizes.at[OF_JOINTS];
    int moving = 0;
    if (asked & OF_INERTIA) {
        moving = accelerate(l, b, q, x, rate, acceleration, centre, room, found);
        for (int i = 0; i < m; i++) found->inertia[i] = 0.0;
    }
    if (asked & OF_PULLS) {
        place(l, found->still, b->home.at, FULL, room);
        point_at(b, b->home.at, k, found->origin, found->point);
        masses_at(b, found->still, b->home.at, k, found->mass);
        work_of(l, b, 0.0, 0, found);
        pulls_of(l, b, room, found, found->pull_home);
    }
    place(l, q, x, FULL, room);
    point_at(b, x, k, centre, found->point);
    masses_at(b, q, x, k, found->mass);
    if (moving) {
        work_of(l, b, payload, 1, found);
        moved(l, found->u_x, 1, room, found->by_q, 0);
        for (int i = 0; i < m; i++) found->inertia[i] = found->u_q[i] + found->by_q[i];
    }
    work_of(l, b, payload, 0, found);
    if (asked & OF_PULLS) pulls_of(l, b, room, found, found->pull);
    if (asked & OF_WEIGHT) {
        moved(l, found->u_x, 1, room, found->by_q, found->by_g);
        for (int i = 0; i < m; i++) found->gravity[i] = found->u_q[i] + found->by_q[i];
        copy_into(found->load, found->by_g, l->sizes.at[OF_DIMENSIONS]);
    }
}

/* --- effects, and where the machine stands ------------------------------------------------- */

/* Add what all terms do to a stage. */
static void add_shift(const Table *t, const double *signals, const double *values, double *work,
                      double *shift) {
    for (int term = 0; term < t->law.n; term++) {
        const int *span = t->span.at + term * SPAN;
        double *here = work + span[W_AT];
        for (int i = 0; i < span[S_COUNT]; i++)
            here[i] = signals[t->signal.at[span[S_AT] + i]];
        for (int i = 0; i < span[V_COUNT]; i++)
            here[span[S_COUNT] + i] = values[t->value.at[span[V_AT] + i]];
        t->law.at[term](here);
        for (int i = 0; i < span[O_COUNT]; i++) {
            const int row = t->output.at[span[O_AT] + i];
            if (row >= 0) shift[row] += here[span[T_F_AT] + i];
        }
    }
}

static void take_dimensions(const Body *b, const double *g, State *state) {
    copy_into(state->geometry, g, b->limbs.sizes.at[OF_DIMENSIONS]);
    set_geometry(&b->limbs, g, &state->room);
    set_masses(&b->limbs, &b->bearing, g, &state->carried);
}

/* Bring the pose x to joints q from wherever the mechanism's direct problem starts. */
static int opened(const Body *b, const double *q, double *x, double stray, State *state) {
    const Opening *o = &b->opening;
    const int p = b->limbs.sizes.at[OF_DIMENSIONS], k = b->limbs.sizes.at[OF_POSE];
    if (!o->law.n) {
        copy_into(x, b->bearing.home.at, k);
        return follow(b, q, x, stray, &state->room);
    }
    double *work = state->opening;
    for (int i = 0; i < o->dims.n; i++) {
        const int row = o->dims.at[i];
        work[o->at.at[1] + i] = row < p ? state->geometry[row] : b->limbs.fixed.at[row - p];
    }
    for (int i = 0; i < o->joints.n; i++) work[o->at.at[0] + i] = q[o->joints.at[i]];
    o->law.at[SETUP](work);
    o->law.at[SHARED](work);
    o->law.at[FULL](work);
    copy_into(x, work + o->at.at[3], k);
    return assemble(&b->limbs, q, x, stray, &state->room);
}

/* Fill in what the machine makes of a sample: pose, dimensions, loads. */
static void add_signals(const Machine *me, double *signals, const double *x, State *state) {
    const int *at = me->stages.at.at, *n = me->body.limbs.sizes.at;
    const int m = n[OF_JOINTS], p = n[OF_DIMENSIONS], r = n[OF_CLOSURES], asked = me->stages.asked;
    const Carried *found = &state->carried;
    copy_into(signals + at[POSE], x, n[OF_POSE]);
    copy_into(signals + at[GEOMETRY], state->geometry, p);
    if (asked == 0) return;
    bear(&me->body.limbs, &me->body.bearing, asked, state->joint, x, signals + at[RATE],
         signals + at[ACCELERATION], signals[at[PAYLOAD]], signals + at[CENTRE], &state->room,
         &state->carried);
    if (asked & OF_WEIGHT) {
        copy_into(signals + at[GRAVITY], found->gravity, m);
        copy_into(signals + at[LOAD], found->load, p);
    }
    if (asked & OF_INERTIA) copy_into(signals + at[INERTIA], found->inertia, m);
    if (asked & OF_PULLS) {
        copy_into(signals + at[PULL], found->pull, r);
        copy_into(signals + at[PULL_HOME], found->pull_home, r);
    }
}

/* Joints behind the drives and dimensions under these conditions. */
static void shift_by(const Machine *me, const double *signals, State *state) {
    const Body *b = &me->body;
    copy_into(state->joint, signals + me->stages.at.at[JOINT], b->limbs.sizes.at[OF_JOINTS]);
    add_shift(&me->stages.drive, signals, me->theta.at, state->drive, state->joint);
    if (me->stages.structure.law.n) {
        copy_into(state->geometry, me->g.at, me->g.n);
        add_shift(&me->stages.structure, signals, me->theta.at, state->structure,
                  state->geometry);
        set_geometry(&b->limbs, state->geometry, &state->room);
        set_masses(&b->limbs, &b->bearing, state->geometry, &state->carried);
    }
}

/* Bring the pose x to where the machine stands under a sample's signals. */
static int stand(const Machine *me, double *signals, int near, double *x, State *state) {
    const Body *b = &me->body;
    const int k = b->limbs.sizes.at[OF_POSE];
    if (me->stages.structure.law.n) take_dimensions(b, me->g.at, state);
    if (!me->stages.stands) {
        shift_by(me, signals, state);
        if (near) return assemble(&b->limbs, state->joint, x, me->stray, &state->room);
        return opened(b, state->joint, x, me->stray, state);
    }
    copy_into(state->joint, signals + me->stages.at.at[JOINT], b->limbs.sizes.at[OF_JOINTS]);
    if (!near && !opened(b, state->joint, x, me->stray, state)) return 0;
    for (int round = 0; round < ROUNDS; round++) {
        copy_into(state->before, x, k);
        add_signals(me, signals, x, state);
        shift_by(me, signals, state);
        if (!assemble(&b->limbs, state->joint, x, me->stray, &state->room)) return 0;
        double most = 0.0;
        for (int i = 0; i < k; i++) most = larger(most, fabs(x[i] - state->before[i]));
        if (most <= SETTLED_POSE) break;
    }
    return 1;
}

/* --- the chain backward -------------------------------------------------------------------- */

/* Place of the tool at pose x, and its slope by the pose. */
static void place_of(const Machine *me, const double *x, Place *room) {
    const Bearing *b = &me->body.bearing;
    const Aimed *aim = &me->aim;
    const int k = me->body.limbs.sizes.at[OF_POSE];
    const int f = b->point_at.at[2], by_x = b->point_at.at[3];
    point_at(b, x, k, aim->tool.at, room->point);
    for (int row = 0; row < aim->axes.n; row++) {
        const int axis = aim->axes.at[row];
        room->place[row] = room->point[f + axis];
        copy_into(room->slope + row * k, room->point + by_x + axis * k, k);
    }
    if (!aim->turns) return;
    for (int arm = 0; arm < 3; arm++) {
        double offset[3];
        for (int i = 0; i < 3; i++) offset[i] = aim->tool.at[i] + (i == arm ? aim->arm : 0.0);
        point_at(b, x, k, offset, room->point);
        for (int axis = 0; axis < 3; axis++) {
            const int row = 3 + 3 * arm + axis;
            room->place[row] = room->point[f + axis] - room->place[axis];
            for (int j = 0; j < k; j++)
                room->slope[row * k + j] =
                    room->point[by_x + axis * k + j] - room->slope[axis * k + j];
        }
    }
}

/* Bring the machine to a command under a sample's signals; its place with it. */
static int stands(const Machine *me, const double *q, const double *signals, int size,
                  Place *room) {
    copy_into(room->signals, signals, size);
    copy_into(room->signals + me->stages.at.at[JOINT], q, me->body.limbs.sizes.at[OF_JOINTS]);
    const int good = stand(me, room->signals, room->near, room->x, &room->state);
    room->near = good && !me->exact;
    if (good) place_of(me, room->x, room);
    return good;
}

static double distance_to(const Place *room, const double *target) {
    double square = 0.0;
    for (int i = 0; i < room->count; i++) {
        const double gap = room->place[i] - target[i];
        square += gap * gap;
    }
    return sqrt(square);
}

/* Distance from the target after a command [m]; infinite where the machine cannot stand. */
static double reached(const Machine *me, const double *q, const double *signals,
                      const double *target, Place *room) {
    if (!stands(me, q, signals, given.size_own, room)) return INFINITY;
    const double far = distance_to(room, target);
    return far < INFINITY ? far : INFINITY;
}

/* The step that brings a place to its target by slope (rows, count), by least squares. */
static int least_squares(const double *slope, int count, const double *target, Place *room) {
    const int rows = room->count, w = room->width;
    double *system = room->normal, *gap = room->place, *step = room->step;
    if (rows < count) {
        for (int i = 0; i < rows; i++) gap[i] -= target[i];
        const int good = least_step(slope, rows, count, gap, system, w, step);
        for (int i = 0; i < rows; i++) gap[i] += target[i];
        return good;
    }
    if (rows == count) {
        for (int row = 0; row < rows; row++) {
            copy_into(system + row * w, slope + row * count, count);
            system[row * w + count] = gap[row] - target[row];
        }
    } else {
        for (int i = 0; i < count; i++) {
            double total;
            for (int j = 0; j < count; j++) {
                total = 0.0;
                for (int row = 0; row < rows; row++)
                    total += slope[row * count + i] * slope[row * count + j];
                system[i * w + j] = total;
            }
            total = 0.0;
            for (int row = 0; row < rows; row++)
                total += slope[row * count + i] * (gap[row] - target[row]);
            system[i * w + count] = total;
        }
    }
    if (!solve(system, w, count, 1)) return 0;
    for (int i = 0; i < count; i++) step[i] = system[i * w + count];
    return 1;
}

/* Correct one command from `best` on; distance that is left [m]. */
static double newton(const double *q, const double *signals, const double *target, double *best,
                     Place *room) {
    const int m = own.body.limbs.sizes.at[OF_JOINTS];
    State *state = &room->state;
    for (int i = 0; i < m; i++) room->there[i] = q[i] + best[i];
    room->near = 0;
    double error = reached(&own, room->there, signals, target, room);
    for (int round = 0; round < search.iterations; round++) {
        const double before = error;
        if (!(search.tolerance < before && before < INFINITY)) break;
        place(&own.body.limbs, state->joint, room->x, FULL, &state->room);
        moved(&own.body.limbs, room->slope, room->count, &state->room, room->by_q, 0);
        if (!least_squares(room->by_q, m, target, room)) break;
        double share = 1.0;
        for (int halving = 0; halving <= search.halvings; halving++, share *= 0.5) {
            for (int i = 0; i < m; i++) {
                const double goal = best[i] - share * room->step[i];
                room->dq[i] = smaller(larger(goal, -search.bound), search.bound);
                room->there[i] = q[i] + room->dq[i];
            }
            const double far = reached(&own, room->there, signals, target, room);
            if (far < error) {
                error = far;
                copy_into(best, room->dq, m);
                break;
            }
        }
        if (!(error < before)) break;
    }
    return error;
}

/* Bring the pose x to the target, whatever the joints say. */
static int bring_pose(const double *target, Place *room) {
    const int k = own.body.limbs.sizes.at[OF_POSE];
    for (int round = 0; round < ROUNDS; round++) {
        place_of(&own, room->x, room);
        if (!least_squares(room->slope, k, target, room)) return 0;
        double most = 0.0;
        for (int i = 0; i < k; i++) {
            most = larger(most, fabs(room->step[i]));
            room->x[i] -= room->step[i];
        }
        if (!(most < INFINITY)) return 0;
        if (most <= SETTLED_POSE) break;
    }
    return 1;
}

/* Bring the joints behind the drives to the pose x. */
static int bring_joints(Place *room) {
    const Limbs *l = &own.body.limbs;
    const int m = l->sizes.at[OF_JOINTS], r = l->sizes.at[OF_CLOSURES];
    State *state = &room->state;
    Room *scratch = &state->room;
    for (int round = 0; round < 2 * ROUNDS; round++) {
        place(l, state->joint, room->x, FULL, scratch);
        spread_joints(l, scratch);
        if (!least_step(scratch->by_q, r, m, scratch->f, scratch->system, scratch->width,
                        room->step))
            return 0;
        double most = 0.0;
        for (int i = 0; i < m; i++) {
            most = larger(most, fabs(room->step[i]));
            state->joint[i] -= room->step[i];
        }
        if (!(most < INFINITY)) return 0;
        if (most <= JOINED) return 1;
    }
    return 0;
}

/* Correct one command by first finding the pose that has the place, then joints and command. */
static double by_pose(const double *q, const double *signals, const double *target, double *best,
                      Place *room) {
    const Limbs *l = &own.body.limbs;
    const int m = l->sizes.at[OF_JOINTS];
    State *state = &room->state;
    double *said = room->there, *shift = room->dq;
    copy_into(said, q, m);
    room->near = 0;
    if (!stands(&own, q, signals, given.size_own, room) || !bring_pose(target, room))
        return INFINITY;
    for (int round = 0; round < ROUNDS; round++) {
        if (own.reshaped) copy_into(state->geometry, own.g.at, own.g.n);
        add_signals(&own, room->signals, room->x, state);
        if (own.reshaped) {
            add_shift(&own.stages.structure, room->signals, own.theta.at, state->structure,
                      state->geometry);
            set_geometry(l, state->geometry, &state->room);
            set_masses(l, &own.body.bearing, state->geometry, &state->carried);
        }
        if (!bring_joints(room)) return INFINITY;
        double most = 0.0;
        copy_into(room->signals + own.stages.at.at[JOINT], said, m);
        for (int i = 0; i < m; i++) shift[i] = 0.0;
        add_shift(&own.stages.drive, room->signals, own.theta.at, state->drive, shift);
        for (int i = 0; i < m; i++) {
            const double goal = state->joint[i] - shift[i];
            most = larger(most, fabs(goal - said[i]));
            said[i] = goal;
        }
        if (!(most < INFINITY)) return INFINITY;
        if (most <= JOINED) break;
    }
    place_of(&own, room->x, room);
    for (int i = 0; i < m; i++) best[i] = said[i] - q[i];
    return distance_to(room, target);
}

/* Correct one command the way that goes with the mechanism; never beyond the bound. */
static void find(const double *q, const double *signals, const double *target, double *best,
                 Place *room) {
    const int m = own.body.limbs.sizes.at[OF_JOINTS];
    double error = own.by_pose ? by_pose(q, signals, target, best, room)
                               : newton(q, signals, target, best, room);
    for (int i = 0; i < m; i++)
        if (!(fabs(best[i]) <= search.bound)) error = INFINITY;
    for (int i = 0; i < m && !(error < INFINITY); i++) best[i] = 0.0;
}

/* --- guards -------------------------------------------------------------------------------- */

static int all_finite(const double *values, int count) {
    for (int i = 0; i < count; i++)
        if (!isfinite(values[i])) return 0;
    return 1;
}

/* How far outside the region a point lies [m]; negative inside. */
static double outside(const double *point) {
    double most = -INFINITY;
    for (int i = 0; i < guards.planes.n; i++) {
        const double *face = guards.planes.at + 4 * i;
        most = larger(most, face[0] * point[0] + face[1] * point[1] + face[2] * point[2]
                                + face[3]);
    }
    return most;
}

/* How far beyond the joints measured a command lies, as far as that moves the tool [m]. */
static double unseen(const double *q, int m) {
    double most = -INFINITY;
    for (int i = 0; i < m; i++)
        most = larger(most, larger(guards.least.at[i] - q[i], q[i] - guards.most.at[i]));
    return guards.typical * most;
}

/* Largest and smallest singular value of a (rows, columns), which is used up: Jacobi, one side. */
static void singular_values(double *a, int rows, int columns, double *most, double *least) {
    const int wide = rows <= columns;
    const int count = wide ? rows : columns, length = wide ? columns : rows;
    const int across = wide ? columns : 1, along = wide ? 1 : columns;
    for (int sweep = 0, turned = 1; turned && sweep < 60; sweep++) {
        turned = 0;
        for (int i = 0; i < count; i++)
            for (int j = i + 1; j < count; j++) {
                double ii = 0.0, jj = 0.0, ij = 0.0;
                for (int e = 0; e < length; e++) {
                    const double u = a[i * across + e * along], v = a[j * across + e * along];
                    ii += u * u;
                    jj += v * v;
                    ij += u * v;
                }
                const double scale = sqrt(ii * jj);
                if (!(fabs(ij) > 1e-15 * scale)) continue;
                if (fabs(ij) > 1e-9 * scale) turned = 1; /* a sweep squares what is left */
                const double zeta = (jj - ii) / (2.0 * ij);
                const double sign = zeta >= 0.0 ? 1.0 : -1.0;
                const double t = sign / (fabs(zeta) + sqrt(1.0 + zeta * zeta));
                const double c = 1.0 / sqrt(1.0 + t * t), s = c * t;
                for (int e = 0; e < length; e++) {
                    const double u = a[i * across + e * along], v = a[j * across + e * along];
                    a[i * across + e * along] = c * u - s * v;
                    a[j * across + e * along] = s * u + c * v;
                }
            }
    }
    *most = 0.0;
    *least = INFINITY;
    for (int i = 0; i < count; i++) {
        double square = 0.0;
        for (int e = 0; e < length; e++) {
            const double u = a[i * across + e * along];
            square += u * u;
        }
        *most = larger(*most, sqrt(square));
        *least = smaller(*least, sqrt(square));
    }
}

/* Whether the drawing's machine, as it stands, is far enough from a singularity. */
static int regular(CommandRoom *room) {
    const int *n = drawn.body.limbs.sizes.at;
    const int t = n[OF_TASK], k = n[OF_POSE], m = n[OF_JOINTS];
    State *state = &room->drawn.state;
    double most, least;
    for (int i = 0; i < t; i++)
        for (int j = 0; j < k; j++) room->task[i * k + j] = i == j ? 1.0 : 0.0;
    place(&drawn.body.limbs, state->joint, room->drawn.x, FULL, &state->room);
    moved(&drawn.body.limbs, room->task, t, &state->room, room->by_q, 0);
    if (!all_finite(room->by_q, t * m)) return 0;
    singular_values(room->by_q, t, m, &most, &least);
    most = larger(most, guards.typical);
    least = smaller(least, guards.typical);
    return most <= guards.condition * least && least > 0.0;
}

/* Whether every cable pulls, a payload that is not known being none. */
static int borne(double payload, const double *centre, CommandRoom *room) {
    const int m = drawn.body.limbs.sizes.at[OF_JOINTS], r = drawn.body.limbs.sizes.at[OF_CLOSURES];
    const int known = payload == payload && all_finite(centre, 3);
    State *state = &room->drawn.state;
    double *still = room->told;
    for (int i = 0; i < m; i++) still[i] = 0.0;
    bear(&drawn.body.limbs, &drawn.body.bearing, guards.pulls, state->joint, room->drawn.x, still,
         still, known ? payload : 0.0, known ? centre : room->origin, &state->room,
         &state->carried);
    for (int i = 0; i < r; i++)
        if (!(state->carried.pull[i] > 0.0)) return 0;
    return 1;
}

/* The first guard that a command fails; the share of its correction that is to be applied. */
static int judged(const double *q, double payload, const double *centre, double *share,
                  CommandRoom *room) {
    const int m = drawn.body.limbs.sizes.at[OF_JOINTS];
    double beyond = INFINITY;
    *share = 0.0;
    if (!all_finite(q, m)) return CORRECT_NOT_FINITE;
    room->drawn.near = 0;
    const int good = stands(&drawn, q, room->signals, given.size_drawn, &room->drawn);
    if (good) {
        copy_into(room->target, room->drawn.place, room->drawn.count);
        point_at(&drawn.body.bearing, room->drawn.x, drawn.body.limbs.sizes.at[OF_POSE],
                 room->origin, room->centre);
        beyond = outside(room->centre + drawn.body.bearing.point_at.at[2]) - guards.on_face;
        beyond = larger(beyond, unseen(q, m));
        if (guards.margin > 0.0)
            *share = smaller(larger(1.0 - larger(beyond, 0.0) / guards.margin, 0.0), 1.0);
        else
            *share = beyond <= 0.0 ? 1.0 : 0.0;
    }
    for (int i = 0; i < m; i++)
        if (!(guards.lower.at[i] <= q[i] && q[i] <= guards.upper.at[i]))
            return CORRECT_JOINT_LIMIT;
    if (!good) return CORRECT_OUT_OF_REACH;
    if (!(beyond <= guards.margin)) return CORRECT_OUTSIDE_REGION;
    if (!regular(room)) return CORRECT_SINGULAR;
    if (guards.pulls && !borne(payload, centre, room)) return CORRECT_SLACK;
    return CORRECT_PASSED;
}

/* What becomes of a correction: its share is applied, or nothing. */
static int finished(const double *q, const double *signals, double share, CommandRoom *room) {
    const int m = own.body.limbs.sizes.at[OF_JOINTS];
    double *dq = room->dq;
    int bounded = 1, code = CORRECT_NOT_REACHED;
    for (int i = 0; i < m; i++) {
        room->told[i] = q[i] + dq[i];
        bounded = bounded && fabs(dq[i]) <= guards.correction;
    }
    room->own.near = 0;
    const double error = reached(&own, room->told, signals, room->target, &room->own);
    if (bounded && (error <= guards.reached || (own.reshaped && error <= guards.stepped))) {
        code = CORRECT_PASSED;
        for (int i = 0; i < m; i++) {
            dq[i] *= share;
            if (!(guards.lower.at[i] <= q[i] + dq[i] && q[i] + dq[i] <= guards.upper.at[i]))
                code = CORRECT_JOINT_LIMIT;
        }
    }
    for (int i = 0; i < m && code != CORRECT_PASSED; i++) dq[i] = 0.0;
    return code;
}

/* --- one command --------------------------------------------------------------------------- */

static void fill_signals(const conditions *at, double *signals) {
    for (int i = 0; i < CORRECT_JOINTS; i++) {
        signals[given.rate + i] = at->rate[i];
        signals[given.acceleration + i] = at->acceleration[i];
        signals[given.direction + i] = at->direction[i];
        signals[given.travel + i] = INFINITY; /* play is crossed by the correction itself */
    }
    signals[given.time] = at->time;
    signals[given.payload] = at->payload;
    copy_into(signals + given.centre, at->payload_centre, 3);
#if CORRECT_TEMPERATURES
    copy_into(signals + given.temperature, at->temperature, CORRECT_TEMPERATURES);
#endif
}

/* Whether all that the machine's effects need of the conditions is known. */
static int all_known(const conditions *at) {
    if (given.needs_payload && !isfinite(at->payload)) return 0;
    if (given.needs_centre && !all_finite(at->payload_centre, 3)) return 0;
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

static void begin_place(const Machine *me, Place *p) {
    const Body *b = &me->body;
    State *s = &p->state;
    for (int limb = 0; limb < b->limbs.joints.n; limb++)
        copy_into(s->room.work + limb * b->size + b->limbs.at.at[C_AT],
                  b->limbs.consts.at + limb * b->limbs.consts.width, b->limbs.consts.width);
    if (b->opening.law.n)
        copy_into(s->opening + b->opening.at.at[2], b->opening.constants.at,
                  b->opening.constants.n);
    copy_into(s->drive, me->stages.drive.work.at, me->stages.drive.work.n);
    copy_into(s->structure, me->stages.structure.work.at, me->stages.structure.work.n);
    take_dimensions(b, me->g.at, s);
}

void correct_begin(double *room) {
    CommandRoom made;
    for (int i = 0; i < CORRECT_ROOM; i++) room[i] = 0.0;
    take_command_room(room, &made);
    begin_place(&drawn, &made.drawn);
    begin_place(&own, &made.own);
}

int correct_in(double *room, const double *q, const conditions *at, double *out) {
    conditions nothing_known;
    CommandRoom made;
    double share;
    if (!at) {
        conditions_at_rest(&nothing_known);
        at = &nothing_known;
    }
    take_command_room(room, &made);
    fill_signals(at, made.signals_own);
    for (int i = 0; i < CORRECT_JOINTS; i++) made.dq[i] = 0.0;
    int code = judged(q, at->payload, at->payload_centre, &share, &made);
    if (code == CORRECT_PASSED && !all_known(at)) code = CORRECT_MISSING_CONDITION;
    if (code == CORRECT_PASSED) {
        find(q, made.signals_own, made.target, made.dq, &made.own);
        code = finished(q, made.signals_own, share, &made);
    }
    for (int i = 0; i < CORRECT_JOINTS; i++) out[i] = q[i] + made.dq[i];
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
