/* Threads that share the rows of a layer.

   A layer takes a millisecond or two, too little for threads that meet in Python. Nobody waits for
   a thread that has not begun: on a busy machine the others may not get a processor in time. */

#include <pthread.h>
#include <stdlib.h>

typedef void rows_work(const void *layer, int first, int last, int who);

typedef struct {
    pthread_mutex_t turn; /* held while a layer is under way */
    pthread_mutex_t lock; /* of all that follows */
    pthread_cond_t begun, done;
    rows_work *work;
    const void *layer;
    int rows, parts, next, left; /* parts that nobody has taken, and that are not done */
    int members, ended;
    pthread_t threads[];
} team;

typedef struct {
    team *of;
    int who;
} member;

/* Parts of a layer for each thread: more leave less to wait for at the end, and fill their blocks
   of tiles less. */
enum { PARTS_OF_THREAD = 2 };

static void take_parts(team *t, int who)
{
    while (t->next < t->parts) {
        int part = t->next++;
        rows_work *work = t->work;
        const void *layer = t->layer;
        int first = (int)((long)t->rows * part / t->parts);
        int last = (int)((long)t->rows * (part + 1) / t->parts);
        pthread_mutex_unlock(&t->lock);
        work(layer, first, last, who);
        pthread_mutex_lock(&t->lock);
        if (--t->left == 0) pthread_cond_signal(&t->done);
    }
}

static void *attend_layers(void *given)
{
    member m = *(member *)given;
    free(given);
    pthread_mutex_lock(&m.of->lock);
    while (!m.of->ended) {
        take_parts(m.of, m.who);
        if (!m.of->ended) pthread_cond_wait(&m.of->begun, &m.of->lock);
    }
    pthread_mutex_unlock(&m.of->lock);
    return NULL;
}

/* A team of so many threads, the caller's among them; NULL where no other could be started. */
void *team_make(int threads)
{
    team *t = calloc(1, sizeof(team) + sizeof(pthread_t) * (threads > 1 ? threads - 1 : 0));
    if (!t) return NULL;
    pthread_mutex_init(&t->turn, NULL);
    pthread_mutex_init(&t->lock, NULL);
    pthread_cond_init(&t->begun, NULL);
    pthread_cond_init(&t->done, NULL);
    for (int who = 1; who < threads; who++) {
        member *m = malloc(sizeof(member));
        if (!m) break;
        *m = (member){t, who};
        if (pthread_create(&t->threads[t->members], NULL, attend_layers, m)) {
            free(m);
            break;
        }
        t->members++;
    }
    return t;
}

/* Ends the team's threads; no layer may be under way. */
void team_end(team *t)
{
    if (!t) return;
    pthread_mutex_lock(&t->lock);
    t->ended = 1;
    pthread_cond_broadcast(&t->begun);
    pthread_mutex_unlock(&t->lock);
    for (int i = 0; i < t->members; i++) pthread_join(t->threads[i], NULL);
    free(t);
}

/* Calls `work` for all rows; alone where there is no team, or where it works for somebody else. */
static void share(team *t, rows_work *work, const void *layer, int rows)
{
    if (!t || !t->members || pthread_mutex_trylock(&t->turn)) {
        work(layer, 0, rows, 0);
        return;
    }
    pthread_mutex_lock(&t->lock);
    int parts = PARTS_OF_THREAD * (t->members + 1);
    t->work = work, t->layer = layer, t->rows = rows;
    t->parts = t->left = rows < parts ? rows : parts;
    t->next = 0;
    pthread_cond_broadcast(&t->begun);
    take_parts(t, 0);
    while (t->left) pthread_cond_wait(&t->done, &t->lock);
    pthread_mutex_unlock(&t->lock);
    pthread_mutex_unlock(&t->turn);
}
