package miPhysics.Engine;

import java.io.BufferedReader;
import java.io.FileReader;
import java.lang.management.ManagementFactory;
import java.lang.management.ThreadMXBean;
import java.util.StringTokenizer;

/**
 * A network of masses, springs and contacts in miPhysics: `MiPhysics FILE WARM FRAMES`.
 *
 * Lines of the file, all numbers a frame: `gravity g`, `mass m x y z dx dy dz` (m = 0: fixed), `spring a b K Z rest`,
 * `bubble a b K Z radius`, `meet radius K Z cells`: all masses meet each other, in so many cells each way. It says how
 * long its thread computed the frames after the warm ones [ns], and where the masses are then.
 */
public class MiPhysics {
    private final PhyModel model;
    private final java.util.ArrayList<Mass> masses = new java.util.ArrayList<>();
    private AutoCollider collider;

    private MiPhysics(String path) throws Exception {
        Medium medium = new Medium();
        medium.setMediumFriction(0.0);
        medium.setGravity(new Vect3D(0, 0, 0));
        model = new PhyModel("scene", medium);
        double radius = 1e-3;
        String line;
        try (BufferedReader lines = new BufferedReader(new FileReader(path))) {
            while ((line = lines.readLine()) != null) {
                StringTokenizer words = new StringTokenizer(line);
                String kind = words.nextToken();
                double[] n = new double[words.countTokens()];
                for (int i = 0; i < n.length; i++) n[i] = Double.parseDouble(words.nextToken());
                switch (kind) {
                    case "gravity": medium.setGravity(new Vect3D(0, 0, n[0])); break;
                    case "radius": radius = n[0]; break;
                    case "mass": mass(n, radius); break;
                    case "spring": join(n, new SpringDamper3D(n[4], n[2], n[3])); break;
                    case "bubble": join(n, new Bubble3D(n[4], n[2], n[3])); break;
                    case "meet":
                        int cells = (int) n[3];
                        collider = new AutoCollider(model, 2 * n[0], cells, cells, cells, n[1], n[2]);
                        break;
                    default: throw new IllegalArgumentException(kind);
                }
            }
        }
        model.init();
    }

    private void mass(double[] n, double radius) {
        Vect3D at = new Vect3D(n[1], n[2], n[3]);
        Mass mass = n[0] == 0.0 ? new Ground3D(radius, at) : new Mass3D(n[0], radius, at);
        // What is fixed meets nothing, and needs no step.
        if (n[0] > 0.0) model.addMass("m" + masses.size(), mass);
        mass.setPosR(new Vect3D(n[1] - n[4], n[2] - n[5], n[3] - n[6]));
        masses.add(mass);
    }

    private void join(double[] n, Interaction link) {
        String name = "l" + model.getInteractionList().size();
        model.addInteraction(name, link, masses.get((int) n[0]), masses.get((int) n[1]));
    }

    private void meet() {
        if (collider == null) return;
        collider.generateSpaceTags();
        collider.computeCollisions();
    }

    private void go(int frames) {
        for (int i = 0; i < frames; i++) {
            model.compute();
            meet();
        }
    }

    public static void main(String[] args) throws Exception {
        MiPhysics scene = new MiPhysics(args[0]);
        // Forces where everything begins; a step moves masses first.
        for (Interaction link : scene.model.getInteractionList()) link.compute();
        scene.meet();
        scene.go(Integer.parseInt(args[1]));
        ThreadMXBean clock = ManagementFactory.getThreadMXBean();
        long start = clock.getCurrentThreadCpuTime();
        scene.go(Integer.parseInt(args[2]));
        System.out.println("took " + (clock.getCurrentThreadCpuTime() - start));
        StringBuilder places = new StringBuilder();
        for (Mass mass : scene.masses) {
            Vect3D at = mass.getPos();
            places.append(at.x).append(' ').append(at.y).append(' ').append(at.z).append('\n');
        }
        System.out.print(places);
    }
}
