#!/usr/bin/env bash
# A data set by a SLURM array job: sbatch --array=0-99 examples/cluster/slurm.sh RECIPE COUNT FOLDER
# Submit it again after failures: scenarios that are done are not rendered again. Then: tiscene merge FOLDER
# Exit status 3 says that scenarios have errors. Other jobs wait for the array by --dependency=afterany.
#SBATCH --job-name=tiscene
#SBATCH --cpus-per-task=8
#SBATCH --mem=8G
#SBATCH --time=04:00:00
#SBATCH --requeue
set -euo pipefail

recipe=$1 count=$2 folder=$3
first=${SLURM_ARRAY_TASK_MIN:-0}
export TI_CPU_MAX_NUM_THREADS=${SLURM_CPUS_PER_TASK:-8}

# exec: so that a signal to the job reaches tiscene, which then saves what it has.
exec tiscene generate "$recipe" -n "$count" -o "$folder" \
    --shard "$((SLURM_ARRAY_TASK_ID - first))/$SLURM_ARRAY_TASK_COUNT"
