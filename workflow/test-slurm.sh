#!/usr/bin/env bash
# Sets up a one-node Slurm without systemd, ingests trials on it with slurm.sh and with Snakemake, cancels one
# shard and kills another each time, compares the results byte by byte with those of an undivided run and shuts
# the node down. It needs trilink and, on Debian:
#   apt-get install slurm-wlm munge
#   pip install snakemake snakemake-executor-plugin-slurm
set -euo pipefail

nights=${NIGHTS:-8} # folders of 42 trials
port=${PORT:-26817} # and the following port
repository=$(cd "$(dirname "$0")/.." && pwd)
home=$(mktemp -d)
node=$home/node
export SLURM_CONF=$node/slurm.conf XDG_CACHE_HOME=$home/cache PATH=$node/bin:/usr/sbin:$PATH
daemons=() snakemake='' passed=false

# Repeats a command until it succeeds, for at most ten minutes.
wait_until() {
    local end=$((SECONDS + 600))
    until "$@"; do
        ((SECONDS < end)) || { echo "not within ten minutes: $*" >&2; return 1; }
        sleep 0.05
    done
}

node_is_idle() { sinfo --noheader --states=idle | grep -q one; }

no_job_is_left() { ! squeue --noheader | grep -q .; }

node_up() {
    local host user munge=$node/munge
    host=$(hostname -s) user=$(id -un)
    mkdir -p "$node"/{bin,munge,spool,state}
    chmod 755 "$home" "$node" "$munge" # or munged refuses its socket
    cat >"$SLURM_CONF" <<END
ClusterName=one-node
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=$port
SlurmdPort=$((port + 1))
SlurmUser=$user
SlurmdUser=$user
AuthInfo=socket=$munge/socket
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
MpiDefault=none
SlurmdParameters=config_overrides
MinJobAge=3600
StateSaveLocation=$node/state
SlurmdSpoolDir=$node/spool
SlurmctldPidFile=$node/slurmctld.pid
SlurmdPidFile=$node/slurmd.pid
# Two shards at a time, whatever the machine has.
NodeName=one NodeHostname=$host NodeAddr=127.0.0.1 CPUs=4 RealMemory=16000
PartitionName=main Nodes=one Default=YES
END
    # Snakemake's plugin removes SLURM_CONF from the environment of srun.
    printf '#!/bin/sh\nSLURM_CONF=%s exec %s "$@"\n' "$SLURM_CONF" "$(command -v srun)" >"$node/bin/srun"
    chmod +x "$node/bin/srun"
    (umask 077 && head -c 128 /dev/urandom >"$munge/key")
    munged --foreground --socket="$munge/socket" --key-file="$munge/key" --pid-file="$munge/pid" \
        --seed-file="$munge/seed" --log-file="$munge/log" &>"$node/munged.txt" &
    daemons+=($!)
    wait_until test -S "$munge/socket"
    slurmctld -D &>"$node/slurmctld.txt" &
    daemons+=($!)
    slurmd -D -N one &>"$node/slurmd.txt" &
    daemons+=($!)
    wait_until node_is_idle
}

node_down() {
    if [ -n "$snakemake" ]; then kill -9 "$snakemake" 2>/dev/null || true; fi
    if [ ${#daemons[@]} = 3 ]; then
        scancel --user="$(id -un)" && scancel --user="$(id -un)" --full --signal=KILL
        wait_until no_job_is_left || true
    fi
    # Munge is stopped last, since the others need it.
    for ((i = ${#daemons[@]} - 1; i >= 0; i--)); do
        kill "${daemons[i]}" || true
        wait "${daemons[i]}" || true
    done
    if $passed; then rm -r "$home"; else echo "failed: see $home" >&2; fi
}

# Cancels a pending shard.
cancel_one() {
    local waiting
    waiting=$(squeue --array --noheader --states=pending --format='%i %r' | grep -v Dependency) || return 1
    scancel "$(tail -n 1 <<<"$waiting" | cut -d ' ' -f 1)"
}

# Kills a running shard of this folder, as the out-of-memory killer would.
kill_one() {
    local process
    for process in $(pgrep -f '(^|/)trilink .*ingest --shard'); do
        if [ "$(readlink "/proc/$process/cwd")" = "$PWD" ]; then
            kill -9 "$process"
            return
        fi
    done
    return 1
}

# Prints the array that `merge --status` asks to resubmit: two shards.
missing_array() {
    trilink merge --status shards >status.txt || [ $? = 1 ]
    cat status.txt >&2
    grep -oxE -- '--array=[0-9]+,[0-9]+' status.txt
}

same_as_undivided() {
    diff -r --exclude=up-to-date.json --exclude=.lock ../undivided/derived derived
    diff -r --exclude=run.json --exclude='history.*' ../undivided/reports reports
    echo "$1: the same bytes as the undivided run ($SECONDS s)"
}

for program in trilink munged slurmctld slurmd sbatch snakemake; do
    command -v "$program" >/dev/null || { echo "needed: $program" >&2; exit 1; }
done

mkdir -p "$home/undivided" && cd "$home/undivided"
sed 's|^raw = "raw/demo"|raw = "raw/*"|' "$repository/pipeline.toml" >pipeline.toml
cp -r "$repository/workflow" .
for ((night = 1; night <= nights; night++)); do
    trilink --quiet synth "raw/night-$night" --noise-seed "$night"
done
for copy in array snakemake; do
    mkdir ../$copy
    cp -r pipeline.toml workflow ../$copy
    ln -s ../undivided/raw ../$copy/raw
done
trilink run

trap node_down EXIT
node_up

cd ../array
SECONDS=0
sed 's/^bootstrap = 200/bootstrap = 20/' ../undivided/pipeline.toml >pipeline.toml
workflow/slurm.sh ingest --array=1-8%2
wait_until cancel_one
wait_until kill_one
wait_until no_job_is_left
array=$(missing_array)
grep -e "$array" logs/merge-*.txt
workflow/slurm.sh ingest "$array"
wait_until no_job_is_left
cp ../undivided/pipeline.toml .
REPLICATES=200 PARTS=4 workflow/slurm.sh fit
wait_until no_job_is_left
same_as_undivided "workflow/slurm.sh"

cd ../snakemake
SECONDS=0
on_slurm=(snakemake --profile workflow/profiles/slurm --config fit_parts=4
    --slurm-status-command squeue --slurm-init-seconds-before-status-checks 5)
"${on_slurm[@]}" &>first.txt &
snakemake=$!
wait_until cancel_one
wait_until kill_one
if wait $snakemake; then echo "Snakemake did not see that two parts failed" >&2; exit 1; fi
grep -E "SLURM-job '[0-9]+' failed" first.txt
missing_array
"${on_slurm[@]}" &>second.txt
same_as_undivided Snakemake
passed=true
